// The connection's states with a fake socket and a fake clock.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Connection } from '../../clients/js/connection.js';
import { encodePicture } from './headers.mjs';

class World {
  constructor() {
    this.now = 1_700_000_000_000;
    this.timers = new Map();
    this.ids = 0;
    this.sockets = [];
    this.health = null; // response of /healthz; null: unreachable
    this.random = () => 1;
    const world = this;
    this.WebSocket = class {
      constructor(url, protocol) {
        Object.assign(this, { url, protocol, readyState: 0, sent: [] });
        world.sockets.push(this);
      }

      send(text) { this.sent.push(JSON.parse(text)); }

      close() { this.readyState = 3; }
    };
  }

  nowMs() { return this.now; }

  setTimeout(then, ms) {
    this.timers.set(++this.ids, { then, at: this.now + ms });
    return this.ids;
  }

  clearTimeout(id) { this.timers.delete(id); }

  async fetch() {
    if (!this.health) throw new TypeError('unreachable');
    return { json: async () => this.health };
  }

  // Advances time, timer by timer.
  async pass(ms) {
    const until = this.now + ms;
    for (;;) {
      await null;
      const due = [...this.timers].filter(([, t]) => t.at <= until).sort((a, b) => a[1].at - b[1].at)[0];
      if (!due) break;
      this.now = Math.max(this.now, due[1].at);
      this.timers.delete(due[0]);
      due[1].then();
    }
    this.now = until;
    for (let i = 0; i < 10; i++) await null;
  }

  get socket() { return this.sockets[this.sockets.length - 1]; }

  open() {
    this.socket.readyState = 1;
    this.socket.onopen();
  }

  // Events of a dropped socket are ignored.
  hear(message) { this.socket.onmessage?.({ data: JSON.stringify(message) }); }

  welcome(session = 'a', major = 1, formats = ['jpeg', 'exr_half', 'exr_float']) {
    this.hear({ op: 'welcome', version: { major, minor: 1 }, session, formats });
  }

  status(state = 'live', detail = '', fps = 30, more = {}) { this.hear({ op: 'status', source: { state, detail }, fps, ...more }); }

  picture(sequence) {
    const header = {
      format: 'jpeg', flags: 0, sequence, frame: sequence, captureUs: 0, publishedUs: 0, queuedUs: 0, decodedUs: 0,
      shadedUs: 0, encodedUs: 0, width: 4, height: 4, gain: 1, samples: 1, payload: 1,
    };
    const bytes = new Uint8Array(81);
    bytes.set(encodePicture(header));
    this.socket.onmessage({ data: bytes.buffer });
  }

  shut(code, reason = '') {
    this.socket.readyState = 3;
    this.socket.onclose({ code, reason });
  }

  said(op) { return this.socket.sent.filter((message) => message.op === op); }
}

function begin() {
  const world = new World();
  const states = [];
  const pictures = [];
  const connection = new Connection('ws://127.0.0.1:1/ws', {
    state: (state) => states.push(state.name),
    status: () => {},
    picture: (header) => pictures.push(header.sequence),
  }, world);
  connection.start();
  return { world, connection, states, pictures };
}

async function live() {
  const all = begin();
  all.world.open();
  all.world.welcome();
  all.world.status();
  all.world.picture(1);
  await all.world.pass(10);
  assert.equal(all.connection.state.name, 'live');
  return all;
}

test('hello comes first, then subscribe and pings', async () => {
  const { world } = begin();
  assert.equal(world.socket.protocol, 'relight.v1');
  world.open();
  assert.deepEqual(world.socket.sent, [{ op: 'hello', role: 'viewer', version: { major: 1, minor: 2 } }]);
  world.welcome();
  await world.pass(1000);
  assert.equal(world.said('subscribe').length, 1);
  assert.equal(world.said('subscribe')[0].paused, false);
  assert.ok(world.said('ping').length >= 4);
});

test('the source’s states map to the page’s', async () => {
  const { world, connection } = begin();
  world.open();
  world.welcome();
  world.status('waiting', 'nothing there');
  assert.deepEqual(connection.state, { name: 'waiting', detail: 'nothing there' });
  world.status('live');
  assert.equal(connection.state.name, 'connecting'); // until the first picture
  world.picture(1);
  assert.equal(connection.state.name, 'live');
  for (const name of ['paused', 'ended']) {
    world.status(name);
    assert.equal(connection.state.name, name);
  }
  world.status('failed', 'a.exr: torn');
  assert.deepEqual(connection.state, { name: 'failed', detail: 'a.exr: torn' });
  world.status('live');
  assert.equal(connection.state.name, 'live');
});

test('an image beyond the server’s limit is reported while it is made', async () => {
  const { world, connection } = await live();
  world.hear({ op: 'status', source: { state: 'live', detail: '' }, fps: 30, frames: { used: 1 }, late: { pictures: 1, seconds: 12.3 } });
  assert.deepEqual(connection.state, { name: 'stalled', late: true, seconds: 12 });
  world.status('live');
  assert.equal(connection.state.name, 'live');
});

test('only a delivering source can stall: other states survive silence until the connection is lost', async () => {
  for (const name of ['waiting', 'failed', 'paused', 'ended']) {
    const { world, connection } = await live();
    world.status(name, 'Because.');
    const states = new Set();
    for (let i = 0; i < 11; i++) {
      await world.pass(1000);
      states.add(connection.state.name);
    }
    assert.deepEqual([...states], [name]);
    await world.pass(2000);
    assert.ok(['reconnecting', 'connecting'].includes(connection.state.name), connection.state.name);
  }
});

test('refinement of a still sky is part of the state', async () => {
  const { world, connection } = begin();
  world.open();
  world.welcome();
  world.status('ended', '', 0, { frames: { used: 0 } });
  assert.deepEqual(connection.state, { name: 'ended', still: undefined, made: false, single: false });
  world.status('ended', '', 0, { frames: { used: 1 } });
  assert.deepEqual(connection.state, { name: 'ended', still: undefined, made: true, single: false });
  world.picture(1);
  world.status('ended', '', 0, { frames: { used: 1 }, light: { passes: 4, converged: false } });
  assert.deepEqual(connection.state, { name: 'ended', still: 'better', made: true, single: false });
  world.status('ended', '', 0, { source: { state: 'ended', length: 1 }, frames: { used: 1 }, light: { passes: null } });
  assert.deepEqual(connection.state, { name: 'ended', still: undefined, made: true, single: true });
  world.status('paused', '', 0, { frames: { used: 1 }, light: { passes: 9, converged: true } });
  assert.deepEqual(connection.state, { name: 'paused', still: 'done', made: true });
  world.status('live', '', 30, { frames: { used: 2 }, light: { passes: null, converged: null } });
  assert.equal(connection.state.name, 'live');
});

test('a live sky without new frames is no stall: nothing is requested again', async () => {
  const { world, connection } = await live();
  for (let i = 0; i < 60; i++) {
    await world.pass(1000);
    world.status('live', '', 30, { frame: 1, light: { passes: i < 30 ? 4 : null } }); // picture 1 shows frame 1
    assert.equal(connection.state.name, 'live');
  }
  assert.equal(connection.state.still, 'idle');
  assert.equal(world.sockets.length, 1);
  assert.equal(world.said('subscribe').length, 1);
  world.status('live', '', 30, { frame: 2 });
  assert.equal(connection.state.name, 'stalled'); // a newer frame exists and its picture has not arrived
});

test('H.264 is used if both ends support it, and can be left without reconnecting', async () => {
  const { world, connection } = begin();
  connection.setVideo(true);
  world.open();
  world.welcome('a', 1, ['jpeg', 'exr_half', 'h264']);
  assert.equal(world.said('subscribe').at(-1).format, 'h264');
  connection.setVideo(false);
  assert.equal(world.said('subscribe').at(-1).format, 'jpeg');
  connection.setVideo(true);
  assert.equal(world.said('subscribe').at(-1).format, 'h264');
  assert.equal(world.sockets.length, 1);
  // another server offers none
  world.shut(1001);
  await world.pass(1000);
  world.open();
  world.welcome('b');
  assert.equal(world.said('subscribe').at(-1).format, 'jpeg');
});

test('the limits for slow connections are sent with each subscription', async () => {
  const { world, connection } = begin();
  Object.assign(connection, { maxRate: 7.5, maxWidth: 640 });
  world.open();
  world.welcome('a', 1, ['jpeg', 'h264']);
  connection.setVideo(true);
  for (const message of world.said('subscribe')) assert.deepEqual([message.max_rate, message.max_width], [7.5, 640]);
  assert.equal(world.said('subscribe').length, 2);
  const plain = begin();
  plain.world.open();
  plain.world.welcome('a');
  assert.ok(!('max_rate' in plain.world.said('subscribe')[0]) && !('max_width' in plain.world.said('subscribe')[0]));
});

test('missing video is reported once, before the connection is given up', async () => {
  const { world, connection } = begin();
  let told = 0;
  connection.on.videoSilent = () => {
    told++;
    connection.setVideo(false);
  };
  connection.setVideo(true);
  world.open();
  world.welcome('a', 1, ['jpeg', 'h264']);
  for (let i = 0; i < 14; i++) {
    await world.pass(1000);
    world.status('live', '', 30, { frame: i });
  }
  assert.equal(told, 1);
  assert.equal(world.sockets.length, 1);
  assert.deepEqual([...new Set(world.said('subscribe').map((message) => message.format))], ['h264', 'jpeg']);
  world.picture(1);
  assert.equal(connection.state.name, 'live');
});

test('before a server has made its first image nothing has stalled', async () => {
  const { world, connection } = begin();
  connection.setVideo(true);
  connection.on.videoSilent = () => assert.fail('video was given up');
  world.open();
  world.welcome('a', 1, ['jpeg', 'h264']);
  for (let i = 0; i < 30; i++) {
    await world.pass(1000);
    world.status('live', '', 30, { frames: { used: 0 }, frame: 0, late: { seconds: i } });
    assert.deepEqual([connection.state.name, connection.state.detail], ['connecting', 'preparing']);
  }
  assert.equal(connection.state.seconds, 30);
  assert.equal(world.sockets.length, 1);
});

test('missing video of a still sky is left', async () => {
  const { world, connection } = begin();
  connection.on.videoSilent = () => connection.setVideo(false);
  connection.setVideo(true);
  world.open();
  world.welcome('a', 1, ['jpeg', 'h264']);
  for (let i = 0; i < 5; i++) {
    await world.pass(1000);
    world.status('ended', '', 0, { frames: { used: 1 }, frame: 1 });
  }
  assert.equal(connection.format, 'h264');
  await world.pass(2000);
  assert.equal(connection.format, 'jpeg');
  assert.equal(world.said('subscribe').at(-1).format, 'jpeg');
});

test('an ack carries the time of display on the server clock', async () => {
  const { world, connection } = await live();
  const ping = world.said('ping')[0];
  world.hear({ op: 'pong', id: ping.id, server_us: world.now * 1000 + 5_000_000 });
  connection.displayed(1, world.now + 16);
  const ack = world.said('ack')[0];
  assert.equal(ack.sequence, 1);
  assert.ok(Math.abs(ack.displayed_us - ((world.now + 16) * 1000 + 5_000_000)) <= 10000);
  connection.displayed(7, world.now); // never received: a late message of another session
  assert.equal(world.said('ack').length, 1);
});

test('missing pictures are a stall: subscribed again, then fetched on a new connection', async () => {
  const { world, connection, states } = await live();
  for (let i = 0; i < 5; i++) {
    await world.pass(1000);
    world.status();
  }
  assert.equal(connection.state.name, 'stalled');
  assert.ok(connection.state.seconds >= 2);
  assert.ok(world.said('subscribe').length >= 2);
  for (let i = 0; i < 20 && world.sockets.length === 1; i++) {
    await world.pass(1000);
    world.status();
  }
  assert.equal(world.sockets.length, 2);
  assert.ok(states.includes('reconnecting'));
});

test('a server that renders nothing is not left for that', async () => {
  const { world, connection } = await live();
  for (let i = 0; i < 40; i++) {
    await world.pass(1000);
    world.status('live', '', 0);
  }
  assert.equal(world.sockets.length, 1);
  assert.equal(connection.state.name, 'stalled');
  world.picture(2);
  assert.equal(connection.state.name, 'live');
});

test('slow pictures are no stall', async () => {
  const { world, connection } = await live();
  for (let n = 2; n < 8; n++) {
    await world.pass(4000);
    world.status('live', '', 0.25);
    assert.equal(connection.state.name, 'live');
    world.picture(n);
  }
});

test('silence is a dead connection', async () => {
  const { world, connection, states } = await live();
  await world.pass(5000);
  assert.equal(connection.state.name, 'stalled');
  assert.equal(connection.state.silent, true);
  assert.equal(world.sockets.length, 1);
  await world.pass(15000);
  assert.ok(states.includes('reconnecting'));
  assert.ok(world.sockets.length >= 2);
});

test('retries back off and continue', async () => {
  const { world, connection } = await live();
  world.shut(1006);
  assert.equal(connection.state.name, 'reconnecting');
  const begun = world.now;
  const times = [];
  while (world.now < begun + 120000) {
    const count = world.sockets.length;
    await world.pass(100);
    if (world.sockets.length > count) {
      times.push(world.now - begun);
      world.shut(1006);
      await world.pass(0);
    }
  }
  assert.ok(times[0] <= 400);
  assert.ok(times.length > 10 && times.length < 60, `${times.length} tries`);
  const last = times[times.length - 1] - times[times.length - 2];
  assert.ok(last >= 5000 && last <= 10200, `${last}`);
  // a server that was away for a few seconds is found within three
  const early = times.filter((t) => t < 60000);
  assert.ok(early.every((t, i) => i === 0 || t - early[i - 1] <= 2700));
});

test('a restored network is used at once', async () => {
  const { world, connection } = await live();
  world.shut(1001);
  const count = world.sockets.length;
  connection.retryNow();
  assert.equal(world.sockets.length, count + 1);
  world.open();
  world.welcome('b');
  world.status();
  world.picture(1); // sequence numbers restart in a new session
  assert.equal(connection.state.name, 'live');
});

test('a refusal is final until the user retries', async () => {
  for (const code of [4001, 4004, 4005, 4006, 1009]) {
    const { world, connection } = await live();
    world.shut(code, 'clause 4.1.3: because');
    assert.equal(connection.state.name, 'refused', String(code));
    assert.doesNotMatch(connection.state.detail, /clause|4\.1/);
    assert.ok(connection.state.detail.length > 10);
    await world.pass(60000);
    connection.retryNow();
    assert.equal(world.sockets.length, 1);
    connection.retryNow(true);
    assert.equal(world.sockets.length, 2);
  }
});

test('a full server is not retried before ten seconds', async () => {
  const { world, connection } = begin();
  world.open();
  world.shut(4007);
  assert.equal(connection.state.name, 'reconnecting');
  await world.pass(9000);
  assert.equal(world.sockets.length, 1);
  await world.pass(2000);
  assert.equal(world.sockets.length, 2);
});

test('/healthz explains a failed handshake', async () => {
  const { world, connection } = begin();
  world.shut(1006);
  await world.pass(1);
  assert.equal(connection.state.detail, 'The server cannot be reached.');
  await world.pass(1000);
  world.health = { protocol: 'relight.v1' };
  world.shut(1006);
  await world.pass(1);
  assert.match(connection.state.detail, /is running but did not accept/);
  await world.pass(2000);
  world.health = { protocol: 'relight.v2' };
  world.shut(1006);
  await world.pass(1);
  assert.equal(connection.state.name, 'refused');
  assert.match(connection.state.detail, /relight\.v2/);
});

test('a different major version is refused with a sentence', async () => {
  const { world, connection } = begin();
  world.open();
  world.welcome('a', 2);
  assert.equal(connection.state.name, 'refused');
  assert.match(connection.state.detail, /version 2/);
});

test('a hidden page pauses and a visible one resumes', async () => {
  const { world, connection } = await live();
  connection.setHidden(true);
  assert.deepEqual(connection.state, { name: 'paused', detail: 'hidden' });
  assert.equal(world.said('subscribe').at(-1).paused, true);
  for (let i = 0; i < 60; i++) {
    await world.pass(1000);
    world.status();
  }
  assert.equal(connection.state.name, 'paused'); // no stall while hidden
  connection.setHidden(false);
  assert.equal(world.said('subscribe').at(-1).paused, false);
  assert.ok(world.said('subscribe').at(-1).request > world.said('subscribe').at(-2).request);
  assert.equal(connection.state.name, 'live');
  assert.equal(world.sockets.length, 1);
});

test('a malformed picture is skipped, and many in a row are refused', async () => {
  const { world, connection } = await live();
  const header = { format: 'jpeg', flags: 0, sequence: 9, frame: 9, captureUs: 0, publishedUs: 1, queuedUs: 0, decodedUs: 0,
    shadedUs: 0, encodedUs: 0, width: 4, height: 4, gain: 1, samples: 1, payload: 1 };
  const bad = new Uint8Array(81);
  bad.set(encodePicture(header));
  new DataView(bad.buffer).setBigUint64(16, 1n << 53n, true); // a frame number beyond clause 1.5
  world.socket.onmessage({ data: bad.buffer });
  assert.equal(connection.state.name, 'live');
  assert.equal(world.said('ack').at(-1).sequence, 9);
  for (let i = 0; i < 10; i++) world.socket.onmessage({ data: new Uint8Array(100).buffer });
  assert.equal(connection.state.name, 'refused');
  assert.match(connection.state.detail, /cannot read: [^(]+\.$/);
});

test('unknown messages are ignored', async () => {
  const { world, connection } = await live();
  world.hear({ op: 'later', anything: 1 });
  assert.equal(connection.state.name, 'live');
});

test('stop leaves nothing running', async () => {
  const { world, connection } = await live();
  connection.stop();
  assert.equal(world.timers.size, 0);
  assert.equal(world.socket.readyState, 3);
});
