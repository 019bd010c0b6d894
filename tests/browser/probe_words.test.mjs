// Pure functions of the pixel probe: positions of directions, the chosen pixel, texts. Without a browser.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { FACES, faceOf, fit, fromCross, fromLatLong, pixelAt, readSample, sightAt, toCross, toLatLong } from '../../clients/web/probe_geometry.js';
import { Trace, roundUp } from '../../clients/web/probe_plot.js';
import { countSamples, figure, materialWords, plotWords, rows, summary, sunGradient, sunWords } from '../../clients/web/probe_words.js';

const near = (a, b, by = 1e-9) => assert.ok(Math.abs(a - b) <= by, `${a} is not ${b}`);
const random = (() => {
  let state = 12345;
  return () => {
    state = (state * 1103515245 + 12345) % 2147483648;
    return state / 2147483648;
  };
})();
const direction = () => {
  const y = 2 * random() - 1;
  const phi = 2 * Math.PI * random();
  return [Math.sqrt(1 - y * y) * Math.sin(phi), y, Math.sqrt(1 - y * y) * Math.cos(phi)];
};

test('a day of sun has its length in words and its parts as a gradient', () => {
  assert.equal(sunWords({ hours: 8.999, daylight: 15.5 }), 'The sun can reach this point for 9\u00a0h 0\u00a0min of the 15\u00a0h 30\u00a0min between sunrise and sunset.');
  const parts = sunGradient({ shares: '--0099-3' }, 'sun', 'shade', 'night').match(/(night|color-mix\([^)]*\)) [\d.]+% [\d.]+%/g);
  assert.deepEqual(parts, ['night 0.00% 25.00%', 'color-mix(in srgb, sun 0%, shade) 25.00% 50.00%', 'color-mix(in srgb, sun 100%, shade) 50.00% 75.00%',
    'night 75.00% 87.50%', 'color-mix(in srgb, sun 33%, shade) 87.50% 100.00%']);
});

test('axes are at their conventional positions', () => {
  const at = (w) => Object.values(toLatLong(w));
  assert.deepEqual(at([0, 0, 1]), [0.5, 0.5]);
  assert.deepEqual(at([1, 0, 0]), [0.25, 0.5]); // +X a quarter to the left of the centre
  assert.deepEqual(at([-1, 0, 0]), [0.75, 0.5]);
  near(toLatLong([0, 1, 0]).v, 0);
  near(toLatLong([0, -1, 0]).v, 1);
});

test('both drawings invert their mapping', () => {
  for (let i = 0; i < 500; i++) {
    const w = direction();
    const { u, v } = toLatLong(w);
    fromLatLong(u, v).forEach((c, k) => near(c, w[k], 1e-7));
    const { x, y } = toCross(w);
    fromCross(x, y).forEach((c, k) => near(c, w[k], 1e-7));
  }
  assert.equal(fromCross(0.5, 0.5), null); // no face there
  assert.equal(fromCross(3.5, 2.5), null);
});

// Faces adjacent on the cross are adjacent on the cube: a step across the border is a small turn.
test('the faces of the cross fit together', () => {
  const e = 1e-4;
  const borders = [
    [[1, 1.3], [1, 0]], [[2, 1.3], [1, 0]], [[3, 1.3], [1, 0]], [[1.3, 1], [0, 1]], [[1.3, 2], [0, 1]],
  ];
  for (const [[x, y], [dx, dy]] of borders) {
    const a = fromCross(x - e * dx, y - e * dy);
    const b = fromCross(x + e * dx, y + e * dy);
    assert.ok(Math.hypot(...a.map((c, k) => c - b[k])) < 1e-3, `at ${x}, ${y}`);
  }
  assert.equal(new Set(FACES.map(({ at }) => at.join())).size, 6);
  assert.equal(faceOf([0.1, -0.9, 0.3]).name, '-Y');
});

test('a click selects the pixel under it, whatever bars surround the image', () => {
  const wide = { left: 10, top: 20, width: 1000, height: 400 }; // bars at the sides of 640 x 360
  const { scale, left } = fit(wide, 640, 360);
  assert.equal(pixelAt(wide, 640, 360, 15, 100), null);
  assert.equal(pixelAt(wide, 640, 360, 500, 19), null);
  assert.deepEqual(pixelAt(wide, 640, 360, left + scale * 0.5, 20.5), { x: 0, y: 0 });
  assert.deepEqual(pixelAt(wide, 640, 360, left + scale * 639.5, 419.5), { x: 639, y: 359 });
  const tall = { left: 0, top: 0, width: 320, height: 900 };
  assert.deepEqual(pixelAt(tall, 640, 360, 160, 450), { x: 320, y: 180 });
  assert.equal(pixelAt(tall, 640, 360, 160, 100), null);
});

test('samples are decoded by their state', () => {
  assert.deepEqual(readSample([0, 1, 0]), { w: [0, 1, 0], kind: 'generated', beta: 0, mis: 0, rgb: [0, 0, 0] });
  assert.equal(readSample([0, 1, 0, 0, 0.5, 0]).kind, 'chosen');
  assert.equal(readSample([0, 1, 0, 1, 1, 0.9, 1, 2, 3]).kind, 'blocked');
  const s = readSample([0, 1, 0, 2, 0.5, 0.9, 1, 2, 3]);
  assert.deepEqual([s.kind, s.beta, s.mis, s.rgb], ['effective', 0.5, 0.9, [1, 2, 3]]);
});

test('the visibility map is read by direction', () => {
  const map = Array.from({ length: 32 }, (_, y) => (y < 16 ? '.' : '-').repeat(64));
  map[3] = '#'.repeat(64);
  assert.equal(sightAt(map, [0, 1, 0]), '.');
  assert.equal(sightAt(map, [0, -1, 0]), '-');
  assert.equal(sightAt(map, fromLatLong(0.2, 3.5 / 32)), '#');
  assert.equal(sightAt(map, fromLatLong(0.9999, 0.2)), '.');
});

const answer = {
  x: 3, y: 4, frame: 7, method: 'mis', samples: 2, preset: null, sees: 'surface', picture: [0.1, 0.2, 0.3],
  pixel: { points: 1, escapes: 0, radiance: [0.1, 0.2, 0.3], background: [0, 0, 0],
    reference: { mean: [0.1, 0.2, 0.3], error: [0.001, 0.002, 0.003], estimates: 32 } },
  first: null, escape: null,
  point: { position: [1, 2, -3], normal: [0, 1, 0], behind: false, material: { name: 'plaster', kind: 'phong', exponent: 20 },
    lobe: { kind: 'phong', diffuse: [0.5, 0.5, 0.5], specular: [0.1, 0.1, 0.1], exponent: 20 }, radiance: [0.1, 0.2, 0.3],
    reference: { mean: [0, 0, 0], error: [0, 0, 0], estimates: 32 }, open: 0.5, open_cosine: 0.25, visibility: [] },
  shares: [{ face: '+X', share: 0.25, count: 1, energy: 0.5, generated: 2, chosen: 1, effective: 1, visible: 0 },
    { face: '+Y', share: 0.75, count: 2, energy: 0.5, generated: 2, chosen: 2, effective: 1, visible: 1 }],
  light: [[1, 0, 0], [1, 0, 0, 1, 1, 1, 1, 1, 1], [0, 1, 0, 0, 1, 0], [0, 1, 0, 2, 1, 1, 1, 1, 1]],
  lobes: [],
};

test('the summary describes a probe', () => {
  assert.deepEqual(countSamples(answer), { generated: 4, chosen: 3, effective: 2, visible: 1 });
  assert.equal(summary(answer), 'Pixel 3, 4 shows a surface. Of 4 light samples 3 were chosen for it, 2 are effective and 1 unblocked.'
    + ' Shares: +Y\u00a075\u00a0%, +X\u00a025\u00a0%. 50\u00a0% of the hemisphere above it is open sky.');
  assert.equal(summary({ ...answer, sees: 'sky', point: null, escape: [0, 1, 0] }),
    'Pixel 3, 4 shows the sky. It sees the sky directly, so no light is gathered.');
  const mirror = { ...answer, sees: 'mirror', point: { ...answer.point, behind: true } };
  assert.match(summary(mirror), /^Pixel 3, 4 shows a mirror, and a point seen in it\. /);
});

test('the table has numbers with units', () => {
  const table = Object.fromEntries(rows(answer).map(([label, value, remark]) => [label, `${value} | ${remark}`]));
  assert.match(table['Radiance in the image'], /^0\.1, 0\.2, 0\.3 \| W/);
  assert.match(table.Converged, /^0\.1\u00a0±\u00a00\.001, .* \| W.*8192 samples$/);
  assert.equal(table.Position, '1.00, 2.00, −3.00 m | x, y, z');
  assert.match(table.Material, /^plaster, phong, exponent 20/);
  assert.match(table['Open sky'], /^50\u00a0% \| of the hemisphere; 25\u00a0% cosine-weighted/);
  assert.equal(rows({ ...answer, pixel: null, preset: 'fig1' }).find(([l]) => l === 'Material')[2], 'replaced by a Phong lobe');
  assert.ok(rows({ ...answer, point: null }).every(([label]) => label !== 'Normal'));
  assert.equal(materialWords({ name: 'pane', kind: 'glass', ior: 1.5 }), 'pane, glass, index of refraction 1.5');
});

test('the table divides the light by class, as far as the server does', () => {
  const part = (share) => ({ share, mean: [1, 2, 3], error: [0, 0.1, 0], estimates: 16 });
  const divided = (parts) => rows({ ...answer, pixel: { ...answer.pixel, parts } })
    .filter(([label]) => /light$|^Caustics$|^Background$/.test(label));
  assert.deepEqual(divided({ background: part(0), direct: part(0.6), caustics: part(0.4) }).map(([label, value]) => [label, value]),
    [['Direct light', '60\u00a0%'], ['Caustics', '40\u00a0%'], ['Background', '0\u00a0%']]);
  assert.match(divided({ indirect: part(1) })[0][2], /^1\u00a0±\u00a00, 2\u00a0±\u00a00\.1, 3\u00a0±\u00a00 W/);
  assert.deepEqual([divided(null), divided(undefined)], [[], []]);
});

test('numbers have three significant digits', () => {
  assert.deepEqual([0, 0.012345, 1.2345, 123.45, 123456, -0.5, 1.5e-7, NaN].map(figure),
    ['0', '0.0123', '1.23', '123', '1.23e+5', '−0.5', '1.50e−7', '–']);
});

test('a trace keeps three minutes, and the refined image of a frame', () => {
  const trace = new Trace();
  for (let s = 0; s <= 400; s++) trace.add(1000 * s, [s, s, s], s);
  assert.equal(trace.points[0].t, 220000);
  trace.add(400500, [1, 1, 1], 400, true);
  trace.add(401000, [2, 2, 2], 400, true);
  const last = trace.points.slice(-2).map((p) => p.rgb[0]);
  assert.deepEqual(last, [400, 2]);
  assert.match(plotWords(trace.points), /^Over 180 s the luminance went from 221 to 2, between 2 and 400 /);
  assert.deepEqual([0, 0.013, 1, 1.1, 4.9, 7, 99].map(roundUp), [1, 0.02, 1, 2, 5, 10, 100]);
});
