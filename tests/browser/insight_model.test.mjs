// Pure functions of insight, comparison, snapshot and sky panel, without a browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { percent, sharesOf, words } from '../../clients/web/changes.js';
import { alsoMethod, difference, factsOf, sideWords, warnings } from '../../clients/web/compare_model.js';
import { styleOf } from '../../clients/web/insight_draw.js';
import { Insight, choiceWords, kindOf, latencyParts, logAxis, noiseText, rows } from '../../clients/web/insight_model.js';
import { FLAG_FINER, FLAG_REPEAT } from '../../clients/js/protocol.js';
import { encodePicture } from './headers.mjs';
import { sunDirection } from '../../clients/web/sky_panel.js';
import { fetchPicture, fileName, numbersFormat } from '../../clients/web/snapshot.js';

const header = (more = {}) => ({
  format: 'jpeg', flags: 0, sequence: 1, frame: 7, captureUs: 0, publishedUs: 1.7e15, queuedUs: 1000, decodedUs: 2000,
  shadedUs: 30000, encodedUs: 4000, width: 2, height: 1, gain: 1, samples: 16, payload: 1, ...more,
});
const status = (more = {}, light = {}) => ({
  frame: 7, method: 'auto', camera: 'main', light: { error: 0.01, passes: null, converged: null, paths: 'direct light', left_out: '', ...light }, ...more,
});

test('the stages of latency add up to the time from capture to screen', () => {
  const parts = latencyParts(header(), 1.7e15 + 5000);
  assert.deepEqual(parts, [1, 2, 30, 4, 5]);
  const captured = latencyParts(header({ captureUs: 1.7e15 - 60000 }), 1.7e15 + 5000); // 23 ms before arrival
  assert.deepEqual(captured, [24, 2, 30, 4, 5]);
  assert.equal(captured.reduce((a, b) => a + b), 65);
});

test('a status makes one point of the image that it describes', () => {
  const insight = new Insight();
  insight.picture(header({ frame: 6, shadedUs: 99000 }), NaN, 0);
  insight.picture(header(), NaN, 100);
  insight.picture(header({ frame: 8, shadedUs: 77000 }), NaN, 200);
  const point = insight.status(status(), 250);
  assert.deepEqual([point.frame, point.shadedMs, point.wholeMs, point.error], [7, 30, 37, 0.01]);
  assert.equal(insight.status(status(), 750), null);
  assert.equal(insight.status(status({ frame: 9 }), 800), null, 'of a picture that was not drawn here nothing is known');
  assert.equal(insight.points.length, 1);
  assert.equal(insight.status(status({ frame: 8 }, { error: null }), 900).error, null);
});

test('for a still sky only the newest refinement stays, with its passes', () => {
  const insight = new Insight();
  insight.picture(header(), NaN, 0);
  insight.status(status(), 1);
  insight.picture(header({ flags: FLAG_FINER, shadedUs: 500000 }), NaN, 2);
  insight.status(status({}, { passes: 8, error: 0.002 }), 3);
  insight.picture(header({ flags: FLAG_FINER, shadedUs: 900000 }), NaN, 4);
  insight.status(status({}, { passes: 16, error: 0.001 }), 5);
  assert.deepEqual(insight.points.map((p) => [p.finer, p.passes, p.shadedMs, p.error]), [[false, 0, 30, 0.01], [true, 16, 900, 0.001]]);
});

test('a choice starts when method or paths change, not when counts do', () => {
  const insight = new Insight();
  const tell = (frame, method, paths) => {
    insight.picture(header({ frame }), NaN, frame);
    return insight.status(status({ frame, method }, { paths, left_out: 'caustics: none' }), frame);
  };
  assert.equal(tell(1, 'auto', 'direct light, matte by 4 samples of light (as before)').begins, true);
  assert.equal(tell(2, 'auto', 'direct light, matte by 16 samples of light').begins, undefined);
  assert.equal(tell(3, 'auto', 'direct light with a separate sun, matte by 16 samples of light').begins, true);
  assert.equal(tell(4, 'mis', 'direct light with a separate sun, matte by 16 samples of light').begins, true);
  assert.deepEqual(insight.choices.map((c) => c.number), [1, 2, 3]);
  assert.equal(insight.choices[0].paths, 'direct light, matte by 16 samples of light');
  assert.equal(choiceWords(insight.choices[2], 5004), '3, 5 s ago: mis: direct light with a separate sun, matte by 16 samples of light. Left out: caustics: none.');
  assert.equal(kindOf({ method: 'a', paths: 'x 1.1e+03' }), kindOf({ method: 'a', paths: 'x 0.2' }));
});

test('latency is kept per second, without refined and repeated images', () => {
  const insight = new Insight();
  insight.picture(header(), 1.7e15 + 5000, 10000);
  insight.picture(header({ shadedUs: 50000 }), 1.7e15 + 7000, 10900);
  insight.picture(header({ flags: FLAG_FINER }), 1.7e15 + 9e9, 10950);
  insight.picture(header({ flags: FLAG_REPEAT }), 1.7e15 + 9e9, 10960);
  insight.picture(header(), 1.7e15 + 5000, 11500);
  assert.deepEqual(insight.latency, [1, 2, 40, 4, 6]);
  const table = Object.fromEntries(rows(insight));
  assert.equal(table['Latency: relight'], '40 ms');
  assert.equal(table['Latency: total'], '53 ms');
  insight.picture(header(), 1.7e15, 10000 + 181000);
  assert.equal(insight.seconds.length, 2, 'older than three minutes is forgotten');
});

test('axes contain all values and have round ends', () => {
  for (const values of [[3, 47], [0.00012, 0.9], [5], [], [1e-7, 1e5], [10, 50]]) {
    const { least, most, ticks } = logAxis(values, [10, 100]);
    for (const v of values) assert.ok(least <= v && v <= most, `${v} in ${least}..${most}`);
    assert.ok(ticks.length >= 2 && ticks.length <= 14, `${values}: ${ticks}`);
    for (const v of ticks) assert.match(v.toExponential(), /^[125]e/);
  }
});

test('noise is a plain number, even above the light', () => {
  assert.deepEqual([1.44, 0.01, 0.00003, null].map(noiseText), ['120 %', '10 %', '0.55 %', 'not estimated']);
});

test('methods look different', () => {
  const looks = new Set(Array.from({ length: 25 }, (_, i) => JSON.stringify(styleOf(i))));
  assert.equal(looks.size, 25);
});

test('each side of a comparison is described', () => {
  assert.equal(sideWords('Kept', factsOf(header(), status())), 'Kept: auto, 16 samples, frame 7');
  const finer = factsOf(header({ flags: FLAG_FINER, samples: 128 }), status({}, { passes: 8, converged: true }));
  assert.equal(sideWords('Live', finer), 'Live: auto, 128 samples, 8 passes, converged, frame 7');
  const other = factsOf(header({ flags: FLAG_FINER }), status({ frame: 8 }, { passes: 3, converged: true }));
  assert.equal(other.passes, null, "another frame's passes are not this one's");
  const facts = factsOf(header(), status());
  assert.equal(alsoMethod(facts, status()).method, 'auto');
  assert.equal(alsoMethod(facts, status({ method: 'mis' })).method, 'auto or mis');
  assert.deepEqual(warnings(facts, factsOf(header({ frame: 8, gain: 2 }), status({ camera: 'roof' }))),
    ['different camera', 'different sky frame', 'exposure +1.00 EV']);
  assert.deepEqual(warnings(facts, facts), []);
});

test('the difference is the mean over colours and pixels, and the 95th percentile', () => {
  const a = new Uint8ClampedArray(4 * 100).fill(100);
  const b = a.slice();
  for (let i = 0; i < 4; i++) b[4 * i] = 160; // 4 of 300 values by 60
  for (let i = 10; i < 30; i++) b[4 * i + 1] = 97; // 20 by 3
  b[3] = 0; // alpha does not count
  const { mean, most } = difference(a, b);
  assert.ok(Math.abs(mean - (240 + 60) / 300) < 1e-12);
  assert.equal(most, 3);
});

test('a snapshot’s name has frame and time', () => {
  assert.equal(fileName(header({ frame: 118, publishedUs: Date.UTC(2026, 10, 22, 10, 5, 30) * 1000 }), 'png'), 'relight_frame_118_2026-11-22T10-05-30Z.png');
  assert.equal(numbersFormat(['jpeg', 'exr_half', 'exr_float']), 'exr_float');
  assert.equal(numbersFormat(['jpeg', 'exr_half']), 'exr_half');
  assert.equal(numbersFormat(['jpeg']), null);
});

// A fake server that answers messages with `answers`.
function fakeSocket(answers) {
  return class {
    constructor() {
      this.said = [];
      queueMicrotask(() => this.onopen());
    }
    send(text) {
      const message = JSON.parse(text);
      this.said.push(message);
      for (const data of answers(message)) queueMicrotask(() => this.onmessage?.({ data }));
    }
    close() { this.closed = true; }
  };
}
const picture = (more) => Uint8Array.from([...encodePicture({ ...header(), format: 'exr_float', ...more }), 42]).buffer;
const welcome = JSON.stringify({ op: 'welcome', formats: ['jpeg', 'exr_half', 'exr_float'] });

test('an EXR shows the displayed frame or a newer one: an older one is skipped', async () => {
  const Socket = fakeSocket(({ op, format }) => {
    if (op === 'hello') return [welcome];
    if (op === 'subscribe') return [`{"op":"subscribed","format":"${format}"}`, picture({ flags: FLAG_REPEAT, frame: 3 })];
    return [picture({ frame: 9 })];
  });
  const got = await fetchPicture({ url: 'ws://x/ws', role: 'viewer', frame: 7, Socket });
  assert.deepEqual([got.header.frame, got.header.format, [...got.payload]], [9, 'exr_float', [42]]);
  const Still = fakeSocket(({ op }) => (op === 'hello' ? [welcome] : [picture({ flags: FLAG_REPEAT, frame: 7 })]));
  assert.equal((await fetchPicture({ url: 'ws://x/ws', role: 'viewer', frame: 7, Socket: Still })).header.frame, 7);
  const Refusing = fakeSocket(() => [JSON.stringify({ op: 'error', message: 'all connections are taken' })]);
  await assert.rejects(fetchPicture({ url: 'ws://x/ws', role: 'viewer', frame: 7, Socket: Refusing }), /all connections are taken/);
  const Silent = fakeSocket(() => []);
  await assert.rejects(fetchPicture({ url: 'ws://x/ws', role: 'viewer', frame: 7, Socket: Silent, patienceMs: 20 }), /no image arrived/);
});

test('north is +Z and east is -X, and the sun rotates with the sky', () => {
  const near = (a, b) => a.forEach((v, i) => assert.ok(Math.abs(v - b[i]) < 1e-12, `${a} for ${b}`));
  near(sunDirection({ elevation: 0, azimuth: 0 }), [0, 0, 1]);
  near(sunDirection({ elevation: 0, azimuth: 90 }), [-1, 0, 0]);
  near(sunDirection({ elevation: 90, azimuth: 12 }), [0, 1, 0]);
  near(sunDirection({ elevation: 0, azimuth: 0 }, 90), [1, 0, 0]);
});

test('a change map is told in shares, and only none is 0 %', () => {
  const map = { data: Uint8ClampedArray.from([[255, 0, 0, 255], [255, 255, 0, 255], [0, 255, 255, 255], [0, 0, 0, 255]].flat()) };
  assert.deepEqual(sharesOf(map), { changed: 0.5, computed: 0.5, traced: 0.25 });
  assert.equal(words(sharesOf(map)), '50 % of the pixels changed (red). Light was computed for 50 % (green), with rays to the sun for 25 % (blue).');
  assert.deepEqual([0, 1e-6, 0.0012, 0.1234, 0.9999, 1].map(percent), ['0 %', 'less than 0.1 %', '0.1 %', '12.3 %', 'more than 99.9 %', '100 %']);
});
