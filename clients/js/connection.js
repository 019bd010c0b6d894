// A viewer's connection: speaks relight.v1, tracks the server's clock, reconnects and reports its state. Independent of page and
// canvas, so it runs in a worker, in a page or under test; `world` provides sockets, timers and clock.

import { CREDIT, FLAG_REPEAT, PROTOCOL, VERSION, closePolicy, decodePicture } from './protocol.js';
import { ServerClock } from './clock.js';

const BACKOFF_MS = [300, 600, 1200, 2500];
const BACKOFF_LATE_MS = 10000; // after a minute of retries
const LATER_MS = 10000;
const OPEN_MS = 8000; // from opening to welcome
const QUIET_MS = 2000; // statuses arrive twice a second; after this the state is stalled
const SILENCE_MS = 12000; // the connection is dead; allows for a large image on a slow line
const STALL_MS = 2000;
const CLOSE_WRONG_ROLE = 4004;
const CLOSE_BAD_TOKEN = 4006;
const UNREADABLE_MOST = 10; // images in a row
const WAKE_MS = 3000; // from waking to the first image

export function realWorld() {
  return {
    WebSocket: globalThis.WebSocket,
    fetch: (...args) => globalThis.fetch(...args),
    setTimeout: (...args) => globalThis.setTimeout(...args),
    clearTimeout: (id) => globalThis.clearTimeout(id),
    nowMs: () => performance.timeOrigin + performance.now(), // wall clock that never steps
    random: Math.random,
  };
}

export class Connection {
  // on: {state(state), status(status), welcome(welcome), picture(header, payload), error(message), heard(message)}; heard gets
  // all other messages; videoSilent(): no H.264 image has arrived.
  constructor(url, on, world = realWorld()) {
    this.url = url;
    this.on = on;
    this.world = world;
    this.clock = new ServerClock();
    this.state = { name: 'connecting' };
    this.socket = null;
    this.session = null;
    this.source = null;
    this.hidden = false;
    this.role = 'viewer'; // or 'controller', with fallback to viewer if the server refuses
    this.token = undefined;
    this.quality = 90;
    this.maxRate = this.maxWidth = undefined; // limits: images per second, pixels
    this.coding = undefined; // the format to ask for; by default H.264 if `video` and the server offers it, else JPEG
    this.video = false; // we can decode H.264
    this.offered = [];
    this.attempt = 0;
    this.request = 0;
    this.unreadable = 0; // images in a row
    this.pings = new Map();
    this.pingId = 0;
    this.timers = {};
  }

  start() {
    this.firstTryMs = this.world.nowMs();
    this.open();
    this.every('watch', 250, () => this.watch());
  }

  stop() {
    for (const name of Object.keys(this.timers)) this.cancel(name);
    this.drop();
  }

  // Retries at once, since the network is back or the page visible. After a refusal only the user can retry.
  retryNow(person = false) {
    if (this.state.name === 'reconnecting' || (person && this.state.name === 'refused')) {
      this.attempt = 0;
      this.firstTryMs = this.world.nowMs();
      this.cancel('retry');
      this.open();
    }
  }

  // Connects anew with a token that the user has typed, which may be a controller's or a viewer's.
  useToken(token) {
    this.token = token;
    this.role = 'controller';
    this.retryNow(true);
  }

  setHidden(hidden) {
    if (this.hidden === hidden) return;
    this.hidden = hidden;
    this.sinceMs = this.world.nowMs();
    this.wakes = 0;
    if (this.welcomed) this.subscribe();
    else if (!hidden) this.retryNow();
    this.judge();
  }

  // Sets whether H.264 can be decoded.
  setVideo(video) {
    if (this.video === video) return;
    this.video = video;
    this.wakes = 0;
    if (this.welcomed) this.subscribe();
  }

  get format() {
    return this.coding ?? (this.video && this.offered.includes('h264') ? 'h264' : 'jpeg');
  }

  // The image was drawn: returns its credit and that of earlier skipped ones.
  displayed(sequence, nowMs) {
    if (!this.welcomed || this.pictureSession !== this.session || sequence > this.lastSequence) return;
    const message = { op: 'ack', sequence };
    if (this.clock.known) message.displayed_us = Math.round(nowMs * 1000 + this.clock.offsetUs);
    this.send(message);
  }

  // ---- the socket

  open() {
    this.drop();
    this.welcomed = false;
    this.set({ name: 'connecting' });
    let socket;
    try {
      socket = new this.world.WebSocket(this.url, PROTOCOL);
    } catch (error) {
      this.set({ name: 'refused', detail: `This page cannot open ${this.url}: ${error.message}` });
      return;
    }
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    this.opened = false;
    socket.onopen = () => {
      this.opened = true;
      this.send({ op: 'hello', role: this.role, version: VERSION, token: this.token }); // undefined fields are omitted
    };
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = (event) => this.closed(socket, event.code, event.reason);
    this.after('open', OPEN_MS, () => this.lost('The server does not answer.'));
  }

  // Drops the current socket and ignores its further events.
  drop() {
    const socket = this.socket;
    this.socket = null;
    this.cancel('open');
    this.cancel('ping');
    if (!socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  // Sends a message of another part of the page.
  say(message) {
    if (this.welcomed) this.send(message);
  }

  send(message) {
    if (this.socket && this.socket.readyState === 1) this.socket.send(JSON.stringify(message));
  }

  closed(socket, code, reason) {
    if (socket !== this.socket) return;
    const opened = this.opened;
    this.socket = null;
    this.cancel('open');
    this.cancel('ping');
    this.welcomed = false;
    if (!opened) {
      this.explain();
      return;
    }
    if (this.role === 'controller' && (code === CLOSE_WRONG_ROLE || code === CLOSE_BAD_TOKEN)) {
      this.role = 'viewer';
      this.open();
      return;
    }
    const { policy, text } = closePolicy(code);
    const why = reason.replace(/^clause [\d.]+: /, ''); // which is for those who write clients
    const said = code >= 4000 && why ? `${text} (${why})` : text;
    if (policy === 'never') this.set({ name: 'refused', detail: said, token: code === CLOSE_BAD_TOKEN });
    else this.retry(said, policy === 'later' ? LATER_MS : 0);
  }

  // Browsers hide why a handshake failed; a plain request distinguishes a dead server from a refusal.
  async explain() {
    let detail = 'The server cannot be reached.';
    try {
      const url = new URL('healthz', this.url.replace(/^ws/, 'http'));
      const health = await (await this.world.fetch(url, { cache: 'no-store' })).json();
      if (health.protocol && health.protocol !== PROTOCOL) {
        this.set({ name: 'refused', detail: `The server speaks ${health.protocol}, this viewer ${PROTOCOL}. Reloading the page may help.` });
        return;
      }
      detail = 'The server is running but did not accept the connection.';
    } catch {
      // unreachable
    }
    if (!this.socket) this.retry(detail, 0);
  }

  lost(detail) {
    this.drop();
    this.welcomed = false;
    this.retry(detail, 0);
  }

  retry(detail, leastMs) {
    const now = this.world.nowMs();
    const late = now - this.firstTryMs > 60000;
    const cap = late ? BACKOFF_LATE_MS : BACKOFF_MS[Math.min(this.attempt, BACKOFF_MS.length - 1)];
    this.attempt++;
    // Jitter, so that many viewers do not reconnect at the same moment.
    const wait = Math.max(leastMs, cap * (0.5 + 0.5 * this.world.random()));
    this.set({ name: 'reconnecting', detail, untilMs: now + wait, attempt: this.attempt });
    this.after('retry', wait, () => this.open());
  }

  // ---- messages

  receive(data) {
    this.heardMs = this.world.nowMs();
    if (data instanceof ArrayBuffer) {
      this.takePicture(data);
      return;
    }
    let message;
    try {
      message = JSON.parse(data);
    } catch {
      this.refuse('The server sent a message that is not JSON.');
      return;
    }
    switch (message.op) {
      case 'welcome': this.takeWelcome(message); break;
      case 'status': this.takeStatus(message); break;
      case 'pong': this.takePong(message); break;
      case 'error': this.on.error?.(message); break;
      default: this.on.heard?.(message); break;
    }
  }

  refuse(detail) {
    this.drop();
    this.welcomed = false;
    this.set({ name: 'refused', detail });
  }

  takeWelcome(message) {
    this.cancel('open');
    if (message.version?.major !== VERSION.major) {
      this.refuse(`The server speaks version ${message.version?.major} of the protocol, this viewer ${VERSION.major}. Reloading the page may help.`);
      return;
    }
    this.welcomed = true;
    this.attempt = 0;
    this.firstTryMs = this.heardMs;
    this.session = message.session;
    this.lastSequence = 0;
    this.pictureMs = this.sinceMs = this.heardMs;
    this.source = null;
    this.light = this.frame = this.made = this.none = undefined;
    this.shownFrame = undefined;
    this.offered = message.formats ?? [];
    this.wakes = 0;
    this.clock = new ServerClock();
    this.pings.clear();
    this.on.welcome?.(message);
    this.subscribe();
    for (let i = 0; i < 4; i++) this.after(`ping${i}`, i * 120, () => this.ping());
    this.every('ping', 2000, () => this.ping());
    this.judge();
  }

  subscribe() {
    this.askedMs = this.world.nowMs();
    const { format, quality, maxRate, maxWidth } = this;
    this.send({ // undefined fields are omitted
      op: 'subscribe', request: ++this.request, format, quality, max_rate: maxRate, max_width: maxWidth, paused: this.hidden,
    });
  }

  ping() {
    const id = ++this.pingId;
    if (this.pings.size > 20) this.pings.clear();
    this.pings.set(id, this.world.nowMs() * 1000);
    this.send({ op: 'ping', id });
  }

  takePong(message) {
    const sent = this.pings.get(message.id);
    if (sent === undefined) return;
    this.pings.delete(message.id);
    this.clock.add(sent, message.server_us, this.heardMs * 1000);
  }

  takeStatus(message) {
    this.source = message.source;
    this.fps = message.fps;
    this.frame = message.frame;
    this.light = message.light;
    this.made = message.frames?.used > 0;
    this.none = message.frames?.used === 0; // no image was made yet
    this.lateS = message.late?.seconds; // the image being made exceeds the server's limit
    this.on.status?.(message);
    this.judge();
  }

  takePicture(data) {
    const picture = decodePicture(data);
    if (!picture.ok) {
      this.skipPicture(picture);
      return;
    }
    this.unreadable = 0;
    this.lastSequence = picture.header.sequence;
    this.shownFrame = picture.header.frame;
    this.pictureSession = this.session;
    this.pictureMs = this.heardMs;
    this.wakes = 0;
    this.on.picture(picture.header, picture.payload, this.heardMs);
    this.judge();
  }

  // An image that cannot be read is skipped: many in a row mean that none can.
  skipPicture({ text, clause, sequence }) {
    if (++this.unreadable > UNREADABLE_MOST) {
      this.refuse(`The server sent images that this viewer cannot read: ${text}.`);
      return;
    }
    this.on.error?.({ code: 'bad_picture', clause, message: `an image was skipped: ${text}`, fatal: false });
    if (sequence) this.send({ op: 'ack', sequence });
    if (this.format === 'h264') this.subscribe(); // the chain is broken: it continues at a keyframe
  }

  // ---- the state

  set(state) {
    const before = JSON.stringify(this.state);
    this.state = state;
    if (JSON.stringify(state) !== before) this.on.state(state);
  }

  // Derives the state while connected.
  judge() {
    if (!this.welcomed) return;
    const name = this.source?.state;
    const now = this.world.nowMs();
    const quiet = now - Math.max(this.pictureMs, this.sinceMs);
    // Only a source that delivers can stall; in other states watch() detects silence.
    const resting = ['waiting', 'failed', 'paused', 'ended'].includes(name);
    const allowed = STALL_MS + (this.fps > 0 ? 3000 / this.fps : 3000);
    // For a still sky the server refines the image with unbiased passes until it has converged.
    const still = this.light?.passes > 0 ? (this.light.converged ? 'done' : 'better') : undefined;
    const newest = this.lastSequence > 0 && this.shownFrame === this.frame;
    if (this.hidden) this.set({ name: 'paused', detail: 'hidden' });
    else if (!resting && now - this.heardMs > QUIET_MS)
      this.set({ name: 'stalled', silent: true, seconds: Math.floor((now - this.heardMs) / 1000) });
    // A server's first image takes as long as it takes: nothing has stalled.
    else if (this.none && this.lastSequence === 0 && !resting) this.set({ name: 'connecting', detail: 'preparing', seconds: this.waited(now) });
    else if (this.lateS > 0) this.set({ name: 'stalled', late: true, seconds: Math.floor(this.lateS) });
    else if (name === 'waiting') this.set({ name: 'waiting', detail: this.source.detail });
    else if (name === 'failed') this.set({ name: 'failed', detail: this.source.detail });
    else if (name === 'paused') this.set({ name, still, made: this.made });
    else if (name === 'ended') this.set({ name, still, made: this.made, single: this.source.length === 1 });
    else if (newest && (still || quiet > allowed)) this.set({ name: 'live', still: still ?? 'idle' });
    else if (quiet > allowed) this.set({ name: 'stalled', silent: false, seconds: Math.floor(quiet / 1000) });
    else if (this.lastSequence > 0) this.set({ name: 'live' });
    else this.set({ name: 'connecting', detail: 'picture' });
  }

  // Seconds since the welcome, told in steps, so that a screen reader is not read each of them; 0: few.
  waited(now) {
    const seconds = (now - this.sinceMs) / 1000;
    return seconds < 5 ? 0 : Math.floor(seconds / 5) * 5;
  }

  // Four times a second: detects dead connections, stalls, and missing images after waking.
  watch() {
    if (!this.welcomed) return;
    const now = this.world.nowMs();
    if (now - this.heardMs > SILENCE_MS) {
      this.lost('The server stopped responding.');
      return;
    }
    this.judge();
    // For a still sky no further image may come: try another coding to get the first one.
    if (this.made && this.lastSequence === 0 && this.format === 'h264' && !this.hidden && now - this.askedMs > 2 * WAKE_MS)
      this.on.videoSilent?.();
    if (this.state.name !== 'stalled' || this.state.silent || this.state.late || now - this.askedMs < WAKE_MS) return;
    // The server reports that it renders: subscribe again, and finally reconnect.
    this.wakes++;
    if (this.wakes === 2 && this.format === 'h264') this.on.videoSilent?.();
    else if (this.wakes <= 3) this.subscribe();
    else if (this.fps > 0) this.lost('No image arrived.');
  }

  // ---- timers by name

  after(name, ms, then) {
    this.cancel(name);
    this.timers[name] = this.world.setTimeout(() => {
      delete this.timers[name];
      then();
    }, ms);
  }

  every(name, ms, then) {
    this.after(name, ms, () => {
      this.every(name, ms, then);
      then();
    });
  }

  cancel(name) {
    if (this.timers[name] !== undefined) this.world.clearTimeout(this.timers[name]);
    delete this.timers[name];
  }
}

export { CREDIT, FLAG_REPEAT };
