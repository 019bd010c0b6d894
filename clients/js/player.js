// Connection and decoder: takes commands and emits events, both plain objects, so that it runs in a worker (over postMessage)
// or, without module workers, in the page.

import { Connection } from './connection.js';
import { Video, realWorld, whyNoVideo } from './video.js';

const ASK_MS = 1000; // a browser that has not answered by then gets JPEG until it does
const AGAIN_MS = 15000; // after a failure H.264 is tried again, doubled with each further failure,
const AGAIN_MOST_MS = 300000; // up to this
const GOOD_IMAGES = 100; // so many images make it a new start

// emit(event, transfer). Events: state, welcome, status, error, heard {message: any other server message}, picture
// {header, bitmap, bytes, heardMs, decodeMs}, whose receiver closes the bitmap, and coding {reason, again}: why there is no
// H.264, and whether it will be tried again; reason null: it is tried now.
export class Player {
  constructor(emit, world = realWorld()) {
    this.emit = emit;
    this.world = world;
    this.decoding = false;
    this.next = null;
    this.video = null;
    this.decodes = false; // the browser decodes H.264
    this.failures = 0; // of H.264 in a row
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
        this.world.clearTimeout?.(this.again);
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
        this.failures = 0;
        if (!this.video) this.useVideo(); // another server, or the same one with other settings
        this.emit({ op: 'welcome', welcome, role: this.connection.role });
      },
      status: (status) => this.emit({ op: 'status', status, clock: this.clock() }),
      error: (error) => {
        // Only a refused subscription: a question about a pixel may have the same code.
        if (error.code === 'not_offered' && error.clause?.startsWith('4.3')) this.leaveVideo('the server offers no H.264', false);
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
    if (coding === 'jpeg') this.emit({ op: 'coding', reason: 'JPEG requested', again: false });
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
      this.emit({ op: 'coding', reason, again: false });
      return;
    }
    this.decodes = true;
    this.useVideo();
  }

  useVideo() {
    if (!this.decodes || this.stopped) return;
    let images = 0;
    this.world.clearTimeout?.(this.again);
    this.emit({ op: 'coding', reason: null, again: false });
    this.video = new Video({
      picture: (picture) => {
        if (++images >= GOOD_IMAGES) this.failures = 0;
        this.emit({ op: 'picture', ...picture, clock: this.clock() }, [picture.bitmap]);
      },
      passed: (header) => this.returnCredit(header),
      lost: () => this.connection.subscribe(),
      failed: (why) => this.leaveVideo(why),
    }, this.world);
    this.connection.setVideo(true);
  }

  // Switches to JPEG; the current image stays on screen until the first one arrives. again: the cause may pass.
  leaveVideo(reason, again = true) {
    if (!this.video) return;
    const { video } = this;
    this.video = null;
    video.close();
    this.emit({ op: 'coding', reason, again });
    this.connection.setVideo(false);
    if (!again) return;
    this.again = this.world.setTimeout(() => {
      if (!this.video) this.useVideo();
    }, Math.min(AGAIN_MOST_MS, AGAIN_MS * 2 ** this.failures++));
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
