// The page's texts and numbers: pure functions, no browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { ServerClock } from '../../clients/js/clock.js';
import { Rate, Recent } from '../../clients/web/figures.js';
import {
  betweenSentence, bitsPerSecond, codingName, codingSentence, describe, lightSentence, milliseconds, Pace, publishSentence, stateSentence, stateWord, sunSentence,
  withoutFolders,
} from '../../clients/web/sentences.js';

const STATES = ['connecting', 'waiting', 'live', 'paused', 'ended', 'failed', 'stalled', 'reconnecting', 'refused'];

test('one sentence describes what is shown', () => {
  const status = {
    scene: 'the built-in scene', sky: 'a computed sky', method: 'mis', samples: 64, width: 640, height: 360,
  };
  assert.equal(describe(status),
    'The built-in scene under a computed sky; 640\u00a0×\u00a0360, 64 samples per point, method mis.');
  assert.equal(describe({ ...status, frames: { used: 0 } }), 'The built-in scene under a computed sky; 640\u00a0×\u00a0360.');
  assert.equal(describe({ ...status, sky: '', method: '', samples: 0, width: 0 }), 'The built-in scene.');
  assert.equal(describe({ scene: '/somewhere/scenes/plaza.json', sky: 'skies/sky.%04d.exr' }), 'plaza.json under sky.%04d.exr.');
  assert.equal(describe({ scene: '/home of/my scenes/a court.json', sky: '*.hdr' }), 'A court.json under *.hdr.');
  assert.equal(describe({ scene: '', sky: 'skies/' }), 'A scene under skies.');
  assert.equal(describe(null), '');
});

test('a target of publishing has a sentence without folders', () => {
  const live = { to: 'rtmp://media.example', state: 'live', detail: '', mbit: 3.24, frames: 300, dropped: 0, retries: 1 };
  assert.equal(publishSentence(live), 'Publishing to rtmp://media.example: live, 3.2 Mbit/s.');
  assert.equal(publishSentence({ ...live, dropped: 1 }), 'Publishing to rtmp://media.example: live, 3.2 Mbit/s, 1 frame dropped.');
  assert.equal(publishSentence({ ...live, to: 'hls:/srv/www/hls', state: 'retrying', detail: 'No space left on device', dropped: 12 }),
    'Publishing to hls:hls: failed (No space left on device; trying again), 12 frames dropped.');
  assert.equal(publishSentence({ ...live, to: 'srt://0.0.0.0:9000', state: 'waiting', detail: 'no receiver has connected yet' }),
    'Publishing to srt://0.0.0.0:9000: waiting (no receiver has connected yet).');
});

test('every state has a word and a sentence, with an image and without', () => {
  for (const name of STATES)
    for (const seen of [false, true]) {
      const said = stateSentence({ name, detail: 'Because.', seconds: 3 }, seen);
      assert.ok(said.length >= 5, `${name}: "${said}"`);
      assert.ok(!/undefined|NaN|null/.test(said), said);
      assert.ok(stateWord({ name }).length > 3);
    }
});

test('a published stream says how far behind it is, and why it stands', () => {
  assert.equal(stateWord({ name: 'live', delayMs: 3170 }), 'Live, 3.2 s behind');
  assert.equal(stateWord({ name: 'live', delayMs: 640 }), 'Live, 640 ms behind');
  assert.equal(stateWord({ name: 'live', delayMs: NaN }), 'Live');
  assert.equal(stateSentence({ name: 'connecting', detail: 'stream' }, false), 'Loading the stream.');
  assert.match(stateSentence({ name: 'paused', detail: 'press' }, false), /press the image/);
  assert.match(stateSentence({ name: 'stalled', published: true, seconds: 9 }, true), /^Nothing new has been published for 9 s\. The last image/);
  assert.match(stateSentence({ name: 'stalled', slow: true, seconds: 9 }, true), /^The image has stood still for 9 s: the stream arrives too slowly/);
  assert.match(stateSentence({ name: 'ended', detail: 'publishing' }, true), /^Publishing has ended\. The last image/);
});

test('a stall tells silence from missing images', () => {
  assert.match(stateSentence({ name: 'stalled', silent: false, seconds: 4 }, true), /^The server answers, but has sent no image for 4 s/);
  assert.match(stateSentence({ name: 'stalled', late: true, seconds: 12 }, true), /^The server has been computing one image for 12 s/);
  assert.match(stateSentence({ name: 'stalled', silent: true, seconds: 4 }, true), /^Nothing received from the server for 4 s/);
});

test('a still sky differs from one that has ended, and a refining image from a converged one', () => {
  const told = [
    [{ name: 'ended', made: true }, false, 'The sky stands still. Waiting for its image.'],
    [{ name: 'ended', made: false }, false, 'The sky sequence ended before an image was made.'],
    [{ name: 'ended', made: true }, true, 'The sky sequence has ended. The last image stays on screen.'],
    [{ name: 'ended', made: true, single: true }, true, 'The sky stands still: it is a single image.'],
    [{ name: 'ended', made: true, still: 'better' }, true, 'The sky stands still, and its image is being refined.'],
    [{ name: 'ended', made: true, still: 'done' }, true, 'The sky stands still, and its image has converged.'],
    [{ name: 'ended', made: true, still: 'better' }, false, 'The sky stands still. Waiting for its image.'],
    [{ name: 'paused', made: true }, false, 'The sky is paused. Waiting for its image.'],
    [{ name: 'paused', made: true }, true, 'The sky is paused. The last image stays on screen.'],
    [{ name: 'paused', made: true, still: 'better' }, true, 'The sky is paused, and its image is being refined.'],
    [{ name: 'paused', made: true, still: 'done' }, true, 'The sky is paused, and its image has converged.'],
    [{ name: 'paused', detail: 'hidden' }, true, 'Paused while this page is hidden.'],
    [{ name: 'live', still: 'better' }, true, 'Live. The sky stands still, and its image is being refined.'],
    [{ name: 'live', still: 'idle' }, true, 'Live. No new image for a while.'],
    [{ name: 'live' }, false, 'Waiting for the first image.'],
    [{ name: 'connecting', detail: 'picture' }, false, 'Connected. Waiting for the first image.'],
    [{ name: 'connecting', detail: 'preparing', seconds: 0 }, false, 'Connected. The server is preparing the first image.'],
    [{ name: 'connecting', detail: 'preparing', seconds: 10 }, false, 'Connected. The server is preparing the first image, for 10 s so far.'],
  ];
  for (const [state, seen, want] of told) assert.equal(stateSentence(state, seen), want);
  assert.equal(stateWord({ name: 'ended' }), 'Ended');
  assert.equal(stateWord({ name: 'ended', single: true }), 'Still sky');
  assert.equal(stateWord({ name: 'ended', still: 'better' }), 'Refining');
  assert.equal(stateWord({ name: 'ended', still: 'done' }), 'Converged');
});

test('codings have display names', () => {
  assert.deepEqual(['jpeg', 'h264', undefined].map(codingName), ['JPEG', 'H.264', '']);
  assert.equal(codingSentence('jpeg', 'this browser has no WebCodecs', false), 'JPEG, since this browser has no WebCodecs');
  assert.equal(codingSentence('jpeg', 'the server sent no H.264 image', true), 'JPEG, since the server sent no H.264 image; trying again soon');
  assert.equal(codingSentence('jpeg', 'JPEG requested', false), 'JPEG');
  assert.equal(codingSentence('h264', null, false), 'H.264');
});

test('sentences include the reason', () => {
  assert.equal(stateSentence({ name: 'failed', detail: 'a.exr: byte 3: torn' }, true),
    'A sky frame could not be used: a.exr: byte 3: torn. The last image stays on screen.');
  assert.match(stateSentence({ name: 'waiting', detail: 'no file matches sky/*.exr' }, false), /no file matches/);
});

test('folders of the server are not shown', () => {
  const told = [
    ['/srv/sky data/sky.0012.exr: byte 3: torn', 'sky.0012.exr: byte 3: torn'],
    ['skies/a.exr: Input/output error', 'a.exr: Input/output error'],
    ['watch:/srv/skies: the folder was removed', 'watch:skies: the folder was removed'],
    ["cannot open '/srv/a/b.exr' for (../c/d.hdr)", "cannot open 'b.exr' for (d.hdr)"],
    ['a half/float mix at http://host/path', 'a half/float mix at http://host/path'],
    ['sky.0012.exr: torn', 'sky.0012.exr: torn'],
    ['', ''],
    [undefined, ''],
  ];
  for (const [reason, want] of told) assert.equal(withoutFolders(reason), want);
  assert.match(stateSentence({ name: 'failed', detail: '/srv/a.exr: torn' }, true), /used: a\.exr: torn/);
  assert.match(stateSentence({ name: 'waiting', detail: '/srv/a.exr: torn' }, true), /sky: a\.exr: torn/);
});

test('the sun sentence gives time, elevation and direction', () => {
  assert.equal(sunSentence({ time: '14:35', sun: { elevation: 31.6, azimuth: 225 } }), '14:35 solar time, sun 32° high in the south-west');
  assert.equal(sunSentence({ sun: null, time: '14:35' }), '14:35 solar time');
  assert.equal(sunSentence({ sun: { elevation: -4, azimuth: -10 } }), 'sun 4° below the horizon in the north');
  assert.equal(sunSentence({ sun: null, time: '' }), '');
  assert.equal(betweenSentence({ between: '', delay_s: 0 }), '');
  assert.equal(betweenSentence(undefined), '');
  assert.equal(betweenSentence({ between: 'the sun moves, the rest fades', delay_s: 2.04 }), ' Between skies the sun moves, the rest fades; images are 2.0 s behind.');
});

test('the time left follows the pace since the computation began', () => {
  const pace = new Pace();
  assert.equal(pace.take(null, 0), null);
  assert.equal(pace.take(0.1, 1000), null);
  assert.equal(pace.take(0.12, 3000), null); // too little to tell
  assert.ok(Math.abs(pace.take(0.3, 5000) - 14) < 1e-9); // 0.2 in four seconds, 0.7 to go
  assert.ok(Math.abs(pace.take(0.5, 9000) - 10) < 1e-9);
  assert.ok(Math.abs(pace.take(0.51, 19000) - 10) < 1e-9); // slower: it never rises, but for another cache
  assert.equal(pace.take(0.2, 20000), null); // another camera's cache
  assert.ok(Math.abs(pace.take(0.3, 27000) - 49) < 1e-9);
  assert.equal(pace.take(null, 28000), null);
  assert.equal(pace.take(0.6, 29000), null);
});

test('the light sentence gives noise, progress and what was left out', () => {
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: 0.0004 }), 'Light: direct light. Noise about 2.0 %.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: null, computed: 0.439 }),
    'Light: direct light. Light-transport cache: 43 % computed.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: null, computed: 0.439 }, 12.4),
    'Light: direct light. Light-transport cache: 43 % computed, about 12 s left.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: 0.0001, computed: null, passes: 120, converged: false }),
    'Light: direct light. Noise about 1.0 %. Still sky: 120 passes, refining.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: 0.0001, computed: null, passes: 120, converged: true }),
    'Light: direct light. Noise about 1.0 %. Still sky: 120 passes, converged.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: null, passes: null, converged: null }), 'Light: direct light.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: 'caustics: not requested', error: null }),
    'Light: direct light. Left out: caustics: not requested.');
  assert.equal(lightSentence({ paths: 'direct light', error: 0.04 }), 'Light: direct light. Noise about 20 %.');
  assert.equal(lightSentence({}), '');
  assert.equal(lightSentence(undefined), '');
});

test('numbers are readable', () => {
  assert.equal(milliseconds(1.234), '1.2 ms');
  assert.equal(milliseconds(9.97), '10 ms');
  assert.equal(milliseconds(2044), '2.0 s');
  assert.equal(milliseconds(NaN), '–');
  assert.equal(bitsPerSecond(1e6), '8.0 Mbit/s');
  assert.equal(bitsPerSecond(0), '–');
});

test('a rate covers the last seconds and falls in silence', () => {
  const rate = new Rate(2000);
  assert.equal(rate.perSecond(0), 0);
  for (let t = 0; t <= 5000; t += 40) rate.add(t, 1000);
  assert.ok(Math.abs(rate.perSecond(5000) - 25) < 0.5);
  assert.ok(Math.abs(rate.bytesPerSecond(5000) - 25000) < 500);
  assert.ok(rate.perSecond(6000) < 20);
  assert.equal(rate.perSecond(9000), 0);
});

test('a median covers the last values only', () => {
  const recent = new Recent(3);
  assert.ok(Number.isNaN(recent.median()));
  for (const value of [100, 100, 1, 3, 2]) recent.add(value);
  assert.equal(recent.median(), 2);
});

test('the clock uses the shortest trip and bounds its error', () => {
  const clock = new ServerClock(20);
  const ahead = 1_000_000; // the server's clock is a second ahead
  // asymmetric, varying trip times
  for (const [there, back] of [[5000, 90000], [400, 600], [70000, 1000], [3000, 3000]])
    clock.add(0, there + ahead, there + back);
  assert.equal(clock.rttUs, 6000);
  assert.ok(Math.abs(clock.offsetUs - ahead) <= clock.uncertaintyUs);
  assert.equal(clock.uncertaintyUs, 500);
  clock.add(10, 5, 0); // a clock that stepped back is ignored
  assert.equal(clock.rttUs, 6000);
});
