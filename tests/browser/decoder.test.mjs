// clients/js/video.js with a fake decoder and clock: its input, and the fate of each frame.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Player } from '../../clients/js/player.js';
import { Video, codecOf, whyNoVideo } from '../../clients/js/video.js';

const KEY = 64;
const SPS = [0, 0, 0, 1, 0x67, 0x42, 0xc0, 0x1f, 0x99, 0, 0, 0, 1, 0x68, 1, 0, 0, 1, 0x65, 7];

// A decoder that outputs frames on command, first in, first out.
class World {
  constructor() {
    this.now = 0;
    this.timers = new Map();
    this.ids = 0;
    this.decoders = [];
    this.frames = []; // all frames ever output
    this.secure = true;
    const world = this;
    this.EncodedVideoChunk = class { constructor(init) { Object.assign(this, init); } };
    this.VideoDecoder = class {
      static async isConfigSupported() { return { supported: true }; }

      constructor(on) {
        Object.assign(this, { on, state: 'unconfigured', held: [], configs: [] });
        world.decoders.push(this);
      }

      configure(config) {
        this.configs.push(config);
        this.state = 'configured';
      }

      decode(chunk) {
        assert.equal(this.state, 'configured');
        if (this.refuses) throw new Error('refused');
        this.held.push(chunk);
      }

      close() { this.state = 'closed'; }

      give() {
        const frame = { timestamp: this.held.shift().timestamp, open: true, close() { assert.ok(this.open); this.open = false; } };
        world.frames.push(frame);
        this.on.output(frame);
      }

      fail(name, message) {
        this.state = 'closed';
        this.on.error(Object.assign(new Error(message), { name }));
      }
    };
  }

  nowMs() { return this.now; }

  setTimeout(then, ms) {
    this.timers.set(++this.ids, { then, at: this.now + ms });
    return this.ids;
  }

  clearTimeout(id) { this.timers.delete(id); }

  pass(ms) {
    const until = this.now + ms;
    for (;;) {
      const due = [...this.timers].filter(([, t]) => t.at <= until).sort((a, b) => a[1].at - b[1].at)[0];
      if (!due) break;
      this.now = Math.max(this.now, due[1].at);
      this.timers.delete(due[0]);
      due[1].then();
    }
    this.now = until;
  }

  get decoder() { return this.decoders.at(-1); }
}

function begin() {
  const world = new World();
  const told = { shown: [], passed: [], lost: 0, failed: [] };
  const video = new Video({
    picture: (picture) => told.shown.push(picture),
    passed: (header) => told.passed.push(header.sequence),
    lost: () => { told.lost++; },
    failed: (reason) => told.failed.push(reason),
  }, world);
  const take = (sequence, key = false, payload = key ? SPS : [0, 0, 0, 1, 0x41, 9]) =>
    video.take({ header: { sequence, flags: key ? KEY : 0 }, payload: Uint8Array.from(payload), heardMs: 5 });
  return { world, video, told, take };
}

test('the reason for missing H.264 is given', async () => {
  assert.equal(await whyNoVideo(new World()), null);
  assert.match(await whyNoVideo(Object.assign(new World(), { secure: false })), /secure/);
  assert.match(await whyNoVideo(Object.assign(new World(), { VideoDecoder: undefined })), /WebCodecs/);
  const no = new World();
  no.VideoDecoder.isConfigSupported = async () => ({ supported: false });
  assert.match(await whyNoVideo(no), /does not decode/);
  const torn = new World();
  torn.VideoDecoder.isConfigSupported = async () => { throw new TypeError('odd'); };
  assert.match(await whyNoVideo(torn), /odd/);
});

test('a browser that is slow to say whether it decodes H.264 gets JPEG until it does', async () => {
  const world = new World();
  const real = globalThis.WebSocket;
  let answer;
  world.VideoDecoder.isConfigSupported = () => new Promise((resolve) => { answer = resolve; });
  globalThis.WebSocket = class { close() {} };
  try {
    const player = new Player(() => {}, world);
    const started = player.start({ url: 'ws://a.example/', hidden: false });
    world.pass(1000);
    await started;
    player.connection.offered = ['jpeg', 'h264'];
    assert.equal(player.connection.format, 'jpeg');
    answer({ supported: true });
    await new Promise(setImmediate);
    assert.equal(player.connection.format, 'h264');
    player.command({ op: 'stop' });
  } finally {
    globalThis.WebSocket = real;
  }
});

// A player whose browser decodes H.264, connected to a server that offers it; `coding` are the events so far.
async function playing(then) {
  const real = globalThis.WebSocket;
  globalThis.WebSocket = class { close() {} };
  const world = new World();
  const coding = [];
  const player = new Player((event) => { if (event.op === 'coding') coding.push([event.reason, event.again]); }, world);
  try {
    await player.start({ url: 'ws://a.example/', hidden: false });
    player.connection.receive(JSON.stringify({ op: 'welcome', version: { major: 1 }, formats: ['jpeg', 'h264'] }));
    assert.equal(player.connection.format, 'h264');
    await then({ world, player, connection: player.connection, coding });
  } finally {
    player.command({ op: 'stop' });
    globalThis.WebSocket = real;
  }
}

test('an error about a pixel does not end H.264, a refused subscription does', () => playing(({ connection }) => {
  connection.receive(JSON.stringify({ op: 'error', code: 'not_offered', clause: '4.15.7', message: 'no image yet', request: 77 }));
  assert.equal(connection.format, 'h264');
  connection.receive(JSON.stringify({ op: 'error', code: 'not_offered', clause: '4.3.1', message: 'this server makes no H.264' }));
  assert.equal(connection.format, 'jpeg');
}));

test('H.264 is tried again after a failure that may pass, less and less often', () => playing(({ world, connection, coding }) => {
  let waited = 15000;
  for (let i = 0; i < 7; i++) {
    connection.on.videoSilent();
    assert.equal(connection.format, 'jpeg');
    assert.deepEqual(coding.at(-1), ['the server sent no H.264 image', true]);
    world.pass(Math.min(300000, waited) - 1);
    assert.equal(connection.format, 'jpeg');
    world.pass(1);
    assert.equal(connection.format, 'h264');
    assert.deepEqual(coding.at(-1), [null, false]);
    waited *= 2;
  }
  connection.on.videoSilent();
  connection.receive(JSON.stringify({ op: 'welcome', version: { major: 1 }, formats: ['jpeg', 'h264'] }));
  assert.equal(connection.format, 'h264'); // a new connection is a new start
}));

test('the codec string comes from the stream', () => {
  assert.equal(codecOf(Uint8Array.from(SPS)), 'avc1.42C01F');
  assert.equal(codecOf(Uint8Array.from([0, 0, 1, 0x09, 0xf0, ...SPS.slice(1, 5), 0x64, 0x00, 0x0a, 1])), 'avc1.64000A');
  assert.equal(codecOf(Uint8Array.from([0, 0, 0, 1, 0x65, 1, 2, 3, 4])), null);
  assert.equal(codecOf(Uint8Array.from([0, 0, 1, 0x67, 0x42])), null); // truncated
  assert.equal(codecOf(new Uint8Array(0)), null);
});

test('decoding starts at a keyframe; earlier frames return their credit', () => {
  const { world, told, take } = begin();
  take(1);
  take(2);
  assert.deepEqual(told.passed, [1, 2]);
  assert.equal(world.decoders.length, 0);
  take(3, true);
  take(4);
  assert.deepEqual(world.decoder.configs, [{ codec: 'avc1.42C01F', optimizeForLatency: true }]);
  assert.deepEqual(world.decoder.held.map(({ type, timestamp }) => [type, timestamp]), [['key', 3], ['delta', 4]]);
});

test('each frame comes out with its own header, once', () => {
  const { world, told, take } = begin();
  take(7, true);
  world.pass(4);
  take(8);
  world.pass(3);
  world.decoder.give();
  world.decoder.give();
  assert.deepEqual(told.shown.map((p) => [p.header.sequence, p.bitmap.timestamp, p.decodeMs, p.bytes, p.heardMs]),
    [[7, 7, 7, SPS.length, 5], [8, 8, 3, 6, 5]]);
  take(9, true); // the same parameters: the decoder stays
  assert.equal(world.decoders.length, 1);
  assert.deepEqual(told.passed, []);
});

test('skipped frames return their credit, and unknown ones are closed', () => {
  const { world, told, take } = begin();
  take(1, true);
  take(2);
  take(3);
  world.decoder.held.splice(0, 2);
  world.decoder.give();
  assert.deepEqual(told.passed, [1, 2]);
  assert.equal(told.shown[0].header.sequence, 3);
  world.decoder.held.push({ timestamp: 99 });
  world.decoder.give();
  assert.equal(told.shown.length, 1);
  assert.equal(world.frames.at(-1).open, false);
});

test('new parameters create a new decoder', () => {
  const { world, told, take } = begin();
  take(1, true);
  const first = world.decoder;
  const other = [...SPS];
  other[5] = 0x64;
  take(2, true, other);
  assert.equal(first.state, 'closed');
  assert.deepEqual(told.passed, [1]);
  assert.equal(world.decoder.configs[0].codec, 'avc1.64C01F');
  first.give(); // too late: closed and not shown
  assert.equal(world.frames[0].open, false);
  assert.deepEqual(told.shown, []);
});

test('any fault ends it once, and the rest returns its credit', () => {
  const faults = {
    'the decoder says so': ({ world }) => world.decoder.fail('EncodingError', 'bad data'),
    'it refuses a picture': ({ world, take }) => { world.decoder.refuses = true; take(3); },
    'a key picture has no parameters': ({ take }) => take(3, true, [0, 0, 0, 1, 0x65, 1, 2, 3, 4, 5]),
  };
  for (const [name, fault] of Object.entries(faults)) {
    const all = begin();
    all.take(1, true);
    all.take(2);
    fault(all);
    assert.equal(all.told.failed.length, 1, name);
    assert.ok(all.told.failed[0].length > 3);
    assert.deepEqual(all.told.passed.slice(0, 2), [1, 2], name);
    all.take(4, true);
    assert.equal(all.told.passed.at(-1), 4);
    all.world.pass(10000);
    assert.equal(all.told.failed.length, 1);
    assert.equal(all.world.timers.size, 0);
    assert.equal(all.world.decoders.length, 1);
  }
});

test('three seconds without output are a failure, even if frames keep arriving', () => {
  const { world, told, take } = begin();
  take(1, true);
  for (let i = 2; i < 100 && !told.failed.length; i++) {
    world.pass(33);
    take(i);
  }
  assert.equal(told.failed.length, 1);
  assert.ok(world.now >= 2900 && world.now <= 3200, `${world.now}`);
});

test('a decoder with output, or with nothing to do, is not silent', () => {
  const { world, told, take } = begin();
  take(1, true);
  for (let i = 2; i < 400; i++) {
    world.pass(33);
    take(i);
    world.decoder.give();
  }
  world.decoder.give();
  world.pass(60000);
  assert.deepEqual(told.failed, []);
  assert.equal(world.timers.size, 0);
});

test('a computer that slept gets its time', () => {
  const { world, told, take } = begin();
  take(1, true);
  world.now += 3600000; // no timer ran meanwhile
  world.pass(10);
  assert.deepEqual(told.failed, []);
  world.decoder.give();
  assert.equal(told.shown.length, 1);
});

test('a reclaimed decoder is no failure: it continues at the next keyframe', () => {
  const { world, told, take } = begin();
  take(1, true);
  world.decoder.give();
  world.decoder.fail('QuotaExceededError', 'reclaimed');
  assert.equal(told.lost, 1);
  take(2);
  take(3, true);
  world.decoder.give();
  assert.deepEqual(told.failed, []);
  assert.deepEqual(told.passed, [2]);
  assert.equal(told.shown.at(-1).header.sequence, 3);
});

test('a hidden page releases the decoder and everything in it', () => {
  const { world, video, told, take } = begin();
  take(1, true);
  take(2);
  const first = world.decoder;
  video.forget();
  assert.equal(first.state, 'closed');
  assert.deepEqual(told.passed, [1, 2]);
  assert.equal(world.timers.size, 0);
  take(3);
  take(4, true);
  assert.deepEqual(told.passed, [1, 2, 3]);
  world.decoder.give();
  assert.equal(told.shown[0].header.sequence, 4);
  video.close();
  video.close();
  assert.equal(world.timers.size, 0);
});
