// The page's words and figures: pure functions, no browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Rate, Recent, ServerClock } from '../../clients/web/figures.js';
import {
  bitsPerSecond, codingName, describe, lightSentence, milliseconds, stateSentence, stateWord, sunSentence, withoutFolders,
} from '../../clients/web/sentences.js';

const STATES = ['connecting', 'waiting', 'live', 'paused', 'ended', 'failed', 'stalled', 'reconnecting', 'refused'];

test('one sentence says what is seen', () => {
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

test('every state has a word and a sentence, with a picture and without', () => {
  for (const name of STATES)
    for (const seen of [false, true]) {
      const said = stateSentence({ name, detail: 'Because.', seconds: 3 }, seen);
      assert.ok(said.length >= 5, `${name}: "${said}"`);
      assert.ok(!/undefined|NaN|null/.test(said), said);
      assert.ok(stateWord({ name }).length > 3);
    }
});

test('a stall says whether anything is heard at all', () => {
  assert.match(stateSentence({ name: 'stalled', silent: false, seconds: 4 }, true), /^The server answers, but no picture .* 4 s/);
  assert.match(stateSentence({ name: 'stalled', silent: true, seconds: 4 }, true), /^Nothing has come from the server for 4 s/);
});

test('a sky that stands still is told from one that has ended, and its picture from one that is done', () => {
  const told = [
    [{ name: 'ended', made: true }, false, 'The sky stands still. Its picture is on its way.'],
    [{ name: 'ended', made: false }, false, 'The sky sequence has ended before a picture was made.'],
    [{ name: 'ended', made: true }, true, 'The sky sequence has ended. The last picture stays.'],
    [{ name: 'ended', made: true, still: 'better' }, true, 'The sky stands still, and its picture is getting better.'],
    [{ name: 'ended', made: true, still: 'done' }, true, 'The sky stands still, and its picture is done.'],
    [{ name: 'ended', made: true, still: 'better' }, false, 'The sky stands still. Its picture is on its way.'],
    [{ name: 'paused', made: true }, false, 'The sky is paused. Its picture is on its way.'],
    [{ name: 'paused', made: true }, true, 'The sky is paused. The last picture stays.'],
    [{ name: 'paused', made: true, still: 'better' }, true, 'The sky is paused, and its picture is getting better.'],
    [{ name: 'paused', made: true, still: 'done' }, true, 'The sky is paused, and its picture is done.'],
    [{ name: 'paused', detail: 'hidden' }, true, 'Paused while this page is hidden.'],
    [{ name: 'live', still: 'better' }, true, 'Live. The sky stands still, and its picture is getting better.'],
    [{ name: 'live', still: 'idle' }, true, 'Live. No new sky has come for a while.'],
    [{ name: 'live' }, false, 'The first picture is on its way.'],
    [{ name: 'connecting', detail: 'picture' }, false, 'Connected. The first picture is on its way.'],
  ];
  for (const [state, seen, want] of told) assert.equal(stateSentence(state, seen), want);
  assert.equal(stateWord({ name: 'ended' }), 'Ended');
  assert.equal(stateWord({ name: 'ended', still: 'better' }), 'Getting better');
  assert.equal(stateWord({ name: 'ended', still: 'done' }), 'Done');
});

test('a coding has a name', () => {
  assert.deepEqual(['jpeg', 'h264', undefined].map(codingName), ['JPEG', 'H.264', '']);
});

test('a reason is passed on', () => {
  assert.equal(stateSentence({ name: 'failed', detail: 'a.exr: byte 3: torn' }, true),
    'A sky frame could not be used: a.exr: byte 3: torn. The last picture stays.');
  assert.match(stateSentence({ name: 'waiting', detail: 'no file matches sky/*.exr' }, false), /no file matches/);
});

test('the folders of a server are not shown', () => {
  const told = [
    ['/srv/sky data/sky.0012.exr: byte 3: torn', 'sky.0012.exr: byte 3: torn'],
    ['skies/a.exr: Input/output error', 'a.exr: Input/output error'],
    ['watch:/srv/skies: the folder is gone', 'watch:skies: the folder is gone'],
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

test('the sun stands where it is said to stand', () => {
  assert.equal(sunSentence({ time: '14:35', sun: { elevation: 31.6, azimuth: 225 } }), '14:35 solar time, sun 32° high in the south-west');
  assert.equal(sunSentence({ sun: null, time: '14:35' }), '14:35 solar time');
  assert.equal(sunSentence({ sun: { elevation: -4, azimuth: -10 } }), 'sun 4° below the horizon in the north');
  assert.equal(sunSentence({ sun: null, time: '' }), '');
});

test('the light in the picture is named with its noise and with what is left out', () => {
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: 0.0004 }), 'Light: direct light. Noise about 2.0 %.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: null, computed: 0.439 }),
    'Light: direct light. Light transport: 43 % computed.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: 0.0001, computed: null, passes: 120, converged: false }),
    'Light: direct light. Noise about 1.0 %. Standing still: 120 passes, getting better.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: 0.0001, computed: null, passes: 120, converged: true }),
    'Light: direct light. Noise about 1.0 %. Standing still: 120 passes, done.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: '', error: null, passes: null, converged: null }), 'Light: direct light.');
  assert.equal(lightSentence({ paths: 'direct light', left_out: 'caustics: not asked for', error: null }),
    'Light: direct light. Left out: caustics: not asked for.');
  assert.equal(lightSentence({ paths: 'direct light', error: 0.04 }), 'Light: direct light. Noise about 20 %.');
  assert.equal(lightSentence({}), '');
  assert.equal(lightSentence(undefined), '');
});

test('figures are written so that they can be read', () => {
  assert.equal(milliseconds(1.234), '1.2 ms');
  assert.equal(milliseconds(9.97), '10 ms');
  assert.equal(milliseconds(2044), '2.0 s');
  assert.equal(milliseconds(NaN), '–');
  assert.equal(bitsPerSecond(1e6), '8.0 Mbit/s');
  assert.equal(bitsPerSecond(0), '–');
});

test('a rate is that of the last seconds and falls when nothing comes', () => {
  const rate = new Rate(2000);
  assert.equal(rate.perSecond(0), 0);
  for (let t = 0; t <= 5000; t += 40) rate.add(t, 1000);
  assert.ok(Math.abs(rate.perSecond(5000) - 25) < 0.5);
  assert.ok(Math.abs(rate.bytesPerSecond(5000) - 25000) < 500);
  assert.ok(rate.perSecond(6000) < 20);
  assert.equal(rate.perSecond(9000), 0);
});

test('a median is of the last values only', () => {
  const recent = new Recent(3);
  assert.ok(Number.isNaN(recent.median()));
  for (const value of [100, 100, 1, 3, 2]) recent.add(value);
  assert.equal(recent.median(), 2);
});

test('the clock of the shortest trip is believed, and its error is bounded', () => {
  const clock = new ServerClock(20);
  const ahead = 1_000_000; // the server's clock is a second ahead
  // there and back in lopsided, varying times
  for (const [there, back] of [[5000, 90000], [400, 600], [70000, 1000], [3000, 3000]])
    clock.add(0, there + ahead, there + back);
  assert.equal(clock.rttUs, 6000);
  assert.ok(Math.abs(clock.offsetUs - ahead) <= clock.uncertaintyUs);
  assert.equal(clock.uncertaintyUs, 500);
  clock.add(10, 5, 0); // a clock that stepped back says nothing
  assert.equal(clock.rttUs, 6000);
});
