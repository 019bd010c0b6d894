// Connection and decoder: takes commands and emits events, both plain objects, so that it runs in a worker (over postMessage)
// or, without module workers, in the page.

import { Connection } from './connection.js';
import { Video, realWorld, whyNoVideo } from './video.js';

const ASK_MS = 1000; // a browser that has not answered by then gets JPEG until it does

// emit(event, transfer). Events: state, welcome, status, error, heard {message: any other server message}, picture
// {header, bitmap, bytes, heardMs, decodeMs}, whose receiver closes the bitmap, and coding {reason}: why there is no H.264.
export class Player {
  constructor(emit, world = realWorld()) {
    this.emit = emit;
    this.world = world;
    this.decoding = false;
    this.next = null;
    this.video = null;
  }

  command(message) {
    switch (message.op) {
      case 'start': this.start(message); break;
      case 'displayed': this.connection.displayed(message.sequence, message.nowMs); break;
      case 'hidden': this.hide(message.hidden); break;
      case 'say': this.connection.say(message.message); break;
      case 'token': this.connection.useToken(message.token); break;
      case 'retry': this.connection.retryNow(message.person); break;
      case 'stop':
        this.stopped = true;
        this.video?.close();
        this.connection.stop();
        break;
      default: break;
    }
  }

  // coding: 'jpeg' forces JPEG; otherwise H.264 if both ends support it. maxRate, maxWidth: limits, or undefined.
  async start({ url, hidden, role, token, coding, maxRate, maxWidth }) {
    this.connection = new Connection(url, {
      state: (state) => this.emit({ op: 'state', state }),
      welcome: (welcome) => {
        this.video?.forget();
        this.emit({ op: 'welcome', welcome, role: this.connection.role });
      },
      status: (status) => this.emit({ op: 'status', status, clock: this.clock() }),
      error: (error) => {
        if (error.code === 'not_offered') this.leaveVideo('the server offers no H.264');
        this.emit({ op: 'error', error });
      },
      heard: (message) => this.emit({ op: 'heard', message }),
      picture: (header, payload, heardMs) => this.take({ header, payload, heardMs }),
      videoSilent: () => this.leaveVideo('the server sent no H.264 image'),
    });
    this.connection.hidden = hidden;
    this.connection.role = role ?? 'viewer';
    this.connection.token = token;
    this.connection.maxRate = maxRate;
    this.connection.maxWidth = maxWidth;
    if (coding === 'jpeg') this.emit({ op: 'coding', reason: 'JPEG requested' });
    else await this.openVideo();
    if (!this.stopped) this.connection.start();
  }

  async openVideo() {
    const late = new Promise((resolve) => { this.world.setTimeout(resolve, ASK_MS); });
    await Promise.race([whyNoVideo(this.world).then((reason) => this.answered(reason)), late]);
  }

  // Whether the browser decodes H.264.
  answered(reason) {
    if (this.stopped) return;
    if (reason) {
      this.emit({ op: 'coding', reason });
      return;
    }
    this.video = new Video({
      picture: (picture) => this.emit({ op: 'picture', ...picture, clock: this.clock() }, [picture.bitmap]),
      passed: (header) => this.returnCredit(header),
      lost: () => this.connection.subscribe(),
      failed: (why) => this.leaveVideo(why),
    }, this.world);
    this.connection.setVideo(true);
  }

  // Switches to JPEG; the current image stays on screen until the first one arrives.
  leaveVideo(reason) {
    if (!this.video) return;
    const { video } = this;
    this.video = null;
    video.close();
    this.emit({ op: 'coding', reason });
    this.connection.setVideo(false);
  }

  // Releases the decoder of a hidden page; the server starts again with a keyframe.
  hide(hidden) {
    if (hidden) this.video?.forget();
    this.connection.setHidden(hidden);
  }

  returnCredit(header) {
    this.connection.displayed(header.sequence, performance.timeOrigin + performance.now());
  }

  clock() {
    const { known, offsetUs, uncertaintyUs, rttUs } = this.connection.clock;
    return { known, offsetUs, uncertaintyUs, rttUs };
  }

  // Decodes one image at a time; the newest that arrived meanwhile is next.
  take(picture) {
    if (picture.header.format === 'h264') {
      if (this.video) this.video.take(picture);
      else this.returnCredit(picture.header);
      return;
    }
    this.next = picture;
    if (!this.decoding) this.decodeNext();
  }

  async decodeNext() {
    const { header, payload, heardMs } = this.next;
    this.next = null;
    this.decoding = true;
    try {
      const begun = performance.now();
      const bitmap = await createImageBitmap(new Blob([payload], { type: 'image/jpeg' }), {
        colorSpaceConversion: 'none',
        premultiplyAlpha: 'none',
      });
      const decodeMs = performance.now() - begun;
      const bytes = payload.byteLength;
      this.emit({ op: 'picture', header, bitmap, bytes, heardMs, decodeMs, clock: this.clock() }, [bitmap]);
    } catch (error) {
      this.emit({ op: 'undecodable', sequence: header.sequence, reason: error.message });
      this.returnCredit(header);
    }
    this.decoding = false;
    if (this.next) this.decodeNext();
  }
}
