// Connection and decoder in one: takes commands, gives events, both plain objects, so that the same code serves in a
// worker (over postMessage) and, where there are no module workers, in the page itself.

import { Connection } from './connection.js';

// emit(event, transfer). Events: state, welcome, status, error, heard {message: any other of the server's}, picture {header, bitmap, bytes, heardMs, decodeMs}.
export class Player {
  constructor(emit) {
    this.emit = emit;
    this.decoding = false;
    this.next = null;
  }

  command(message) {
    switch (message.op) {
      case 'start': this.start(message); break;
      case 'displayed': this.connection.displayed(message.sequence, message.nowMs); break;
      case 'hidden': this.connection.setHidden(message.hidden); break;
      case 'say': this.connection.say(message.message); break;
      case 'retry': this.connection.retryNow(message.person); break;
      case 'stop': this.connection.stop(); break;
      default: break;
    }
  }

  start({ url, hidden, role, token }) {
    this.connection = new Connection(url, {
      state: (state) => this.emit({ op: 'state', state }),
      welcome: (welcome) => this.emit({ op: 'welcome', welcome }),
      status: (status) => this.emit({ op: 'status', status, clock: this.clock() }),
      error: (error) => this.emit({ op: 'error', error }),
      heard: (message) => this.emit({ op: 'heard', message }),
      picture: (header, payload, heardMs) => this.take({ header, payload, heardMs }),
    });
    this.connection.hidden = hidden;
    this.connection.role = role ?? 'viewer';
    this.connection.token = token;
    this.connection.start();
  }

  clock() {
    const { known, offsetUs, uncertaintyUs, rttUs } = this.connection.clock;
    return { known, offsetUs, uncertaintyUs, rttUs };
  }

  // One picture is decoded at a time; of those that come meanwhile the newest is next.
  take(picture) {
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
      this.connection.displayed(header.sequence, performance.timeOrigin + performance.now());
    }
    this.decoding = false;
    if (this.next) this.decodeNext();
  }
}
