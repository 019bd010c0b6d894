// A client of relightd for programs: live images, decoded or as bytes, and settings. The page is built on the same modules;
// docs/client-libraries.md has examples, relight.d.ts the types, and protocol/PROTOCOL.md what the messages mean.

import { Connection, realWorld } from './connection.js';
import { Player } from './player.js';
import { PATH } from './protocol.js';

export { Connection } from './connection.js';
export { Player } from './player.js';
export { Video, codecOf, whyNoVideo } from './video.js';
export * from './protocol.js';

const CODINGS = ['jpeg', 'h264', 'exr_half', 'exr_float', 'changes'];

// The server refused a request or the connection.
export class RelightError extends Error {
  constructor(message, { code, clause } = {}) {
    super(message);
    this.name = 'RelightError';
    this.code = code; // of PROTOCOL.md section 8, if there is one
    this.clause = clause;
  }
}

// ws://HOST:PORT/ws and the token behind #, from ws://, wss://, http:// and https:// addresses. A path that ends in / is that of a page.
export function address(text) {
  let url;
  try {
    url = new URL(text, globalThis.location?.href);
  } catch {
    throw new TypeError(`${text}: expected ws://HOST:PORT or wss://HOST:PORT`);
  }
  const scheme = { 'ws:': 'ws:', 'wss:': 'wss:', 'http:': 'ws:', 'https:': 'wss:' }[url.protocol];
  if (!scheme) throw new TypeError(`${text}: expected ws://HOST:PORT or wss://HOST:PORT`);
  const path = url.pathname.endsWith('/') ? url.pathname + PATH : url.pathname;
  return { url: `${scheme}//${url.host}${path}`, token: new URLSearchParams(url.hash.slice(1)).get('token') ?? undefined };
}

// Connects, and connects again after interruptions, until stop(). welcome, status, settings and state are the newest ones.
export class Relight {
  // decode: images have a `bitmap` (a VideoFrame or ImageBitmap, to be closed), H.264 where possible, else JPEG; true where the
  // browser can. Otherwise they have a `payload`, encoded as `coding` says: 'jpeg', 'h264', 'exr_half', 'exr_float' or 'changes'.
  // on: {picture, status, state, settings, heard, error}, all optional. WebSocket: where there is no global one.
  constructor(text, options = {}) {
    const { url, token } = address(text);
    const { role = 'viewer', coding, decode = !coding && typeof globalThis.createImageBitmap === 'function', on = {} } = options;
    if (role !== 'viewer' && role !== 'controller') throw new TypeError(`role ${role}: expected 'viewer' or 'controller'`);
    if (coding !== undefined && !CODINGS.includes(coding)) throw new TypeError(`coding ${coding}: expected one of ${CODINGS.join(', ')}`);
    if (decode && (coding?.startsWith('exr') || coding === 'changes')) throw new TypeError(`coding ${coding} cannot be decoded here: decode must be false`);
    this.on = on;
    this.state = { name: 'connecting' };
    this.asked = new Map(); // requests without an answer: {op, resolve, reject}
    this.request = 0;
    this.newest = null;
    this.waiting = []; // for the next picture: {resolve, reject}
    this.arrivals = []; // for the welcome
    this.chained = !decode && coding === 'h264';
    const { maxRate, maxWidth } = options;
    const wish = { url, role, token: options.token ?? token, maxRate, maxWidth, hidden: false };
    if (decode) this.decodeWith(wish, coding);
    else this.receiveBytes(wish, coding ?? 'jpeg', options);
  }

  decodeWith(wish, coding) {
    const player = new Player((event) => {
      if (event.op === 'picture') this.take(event);
      else if (event.op === 'undecodable') this.on.error?.(new RelightError(`an image cannot be decoded: ${event.reason}`));
      else this.hear(event.op, event);
    });
    this.send = (message) => player.command({ op: 'say', message });
    this.displayed = (sequence, nowMs) => player.command({ op: 'displayed', sequence, nowMs });
    this.end = () => player.command({ op: 'stop' });
    player.command({ op: 'start', ...wish, coding });
  }

  receiveBytes(wish, coding, { quality, WebSocket }) {
    const world = { ...realWorld(), ...(WebSocket && { WebSocket }) };
    if (!world.WebSocket) throw new TypeError('there is no WebSocket here: pass one, such as that of the package ws');
    const connection = new Connection(wish.url, {
      state: (state) => this.hear('state', { state }),
      welcome: (welcome) => this.hear('welcome', { welcome, role: connection.role }),
      status: (status) => this.hear('status', { status }),
      error: (error) => this.hear('error', { error }),
      heard: (message) => this.hear('heard', { message }),
      picture: (header, payload) => this.take({ header, payload }),
    }, world);
    const { role, token, maxRate, maxWidth } = wish;
    Object.assign(connection, { role, token, maxRate, maxWidth, coding, quality: quality ?? connection.quality });
    this.send = (message) => connection.say(message);
    this.displayed = (sequence, nowMs) => connection.displayed(sequence, nowMs);
    this.end = () => connection.stop();
    connection.start();
  }

  // Resolves to the server's welcome once there is a connection.
  connected() {
    if (this.welcome) return Promise.resolve(this.welcome);
    if (this.state.name === 'refused') return Promise.reject(new RelightError(this.state.detail));
    return new Promise((resolve, reject) => this.arrivals.push({ resolve, reject }));
  }

  // Changes settings by the names of PROTOCOL.md 4.13, such as {tone: 'filmic', step: 1}; resolves to all settings.
  control(settings) {
    return this.ask('control', settings, 'controller');
  }

  // Where the light of a pixel comes from (4.15).
  probe(pixel) {
    return this.ask('probe', pixel);
  }

  // The newest image that was not returned yet, or the next one.
  picture() {
    if (this.chained) throw new TypeError('H.264 as bytes needs on.picture, which receives every image: each depends on the one before');
    if (this.state.name === 'refused') return Promise.reject(new RelightError(this.state.detail));
    return new Promise((resolve, reject) => {
      this.waiting.push({ resolve, reject });
      this.hand();
    });
  }

  // All of them: `for await (const picture of relight.pictures())`.
  async* pictures() {
    for (;;) yield await this.picture();
  }

  stop() {
    this.end();
    this.refuseAll(new RelightError('stopped'));
    this.newest?.bitmap?.close();
    this.newest = null;
  }

  // ---- inside

  async ask(op, fields, role) {
    await this.connected();
    if (role && this.role !== role) throw new RelightError(`only a ${role} may do this: connect with that role, and its token`);
    const request = ++this.request;
    return new Promise((resolve, reject) => {
      this.asked.set(request, { op, resolve, reject });
      this.send({ ...fields, op, request });
    });
  }

  take(picture) {
    if (this.on.picture) {
      this.on.picture(picture);
      this.acknowledge(picture);
      return;
    }
    if (this.newest) { // nobody asked for it in time
      this.newest.bitmap?.close();
      this.acknowledge(this.newest);
    }
    this.newest = picture;
    this.hand();
  }

  hand() {
    if (!this.newest || !this.waiting.length) return;
    const picture = this.newest;
    this.newest = null;
    this.acknowledge(picture);
    this.waiting.shift().resolve(picture);
  }

  acknowledge({ header }) {
    this.displayed(header.sequence, performance.timeOrigin + performance.now());
  }

  hear(op, event) {
    if (op === 'state') {
      this.state = event.state;
      if (this.state.name === 'reconnecting' || this.state.name === 'refused') this.lose(this.state);
    } else if (op === 'welcome') {
      this.welcome = event.welcome;
      this.role = event.role;
      for (const { resolve } of this.arrivals.splice(0)) resolve(this.welcome);
    } else if (op === 'status') {
      this.status = event.status;
    } else if (op === 'error') {
      const { request, code, clause, message } = event.error;
      const error = new RelightError(message, { code, clause });
      const asked = this.asked.get(request);
      this.asked.delete(request);
      if (asked) asked.reject(error);
      else this.on.error?.(error);
    } else if (op === 'heard') {
      this.answer(event.message);
    }
    if (op === 'state' || op === 'status') this.on[op]?.(event[op]);
  }

  answer(message) {
    if (message.op === 'control') {
      this.settings = message;
      this.on.settings?.(message);
    }
    // One control may answer several requests in a row; one of another controller answers none.
    const ours = message.op === 'control' ? message.by === this.welcome?.id : message.op === 'probed';
    for (const [request, { op, resolve }] of ours ? [...this.asked] : []) {
      const answers = message.op === 'control' ? op === 'control' && request <= message.request : op === 'probe' && request === message.request;
      if (!answers) continue;
      this.asked.delete(request);
      resolve(message);
    }
    this.on.heard?.(message);
  }

  // Requests are lost with their connection; images resume with the next one, unless the server refused.
  lose({ name, detail }) {
    this.welcome = undefined;
    const error = new RelightError(detail);
    for (const { reject } of this.asked.values()) reject(error);
    this.asked.clear();
    if (name === 'refused') this.refuseAll(error);
  }

  refuseAll(error) {
    for (const { reject } of [...this.asked.values(), ...this.waiting.splice(0), ...this.arrivals.splice(0)]) reject(error);
    this.asked.clear();
  }
}
