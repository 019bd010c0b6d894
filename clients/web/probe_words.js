// A probe's answer as text. Pure functions of `probed` (PROTOCOL.md 4.16).

import { luminance, readSample } from './probe_geometry.js';

export const UNIT = 'W\u00a0sr⁻¹\u00a0m⁻²';
export const RELATIVE = 'relative'; // of a captured sky, or one with a scale

// Three significant digits: 0.0123, 1.23, 123, 1.23e+5.
export function figure(x) {
  if (!Number.isFinite(x)) return '–';
  if (x === 0) return '0';
  const size = Math.abs(x);
  if (size >= 1e5 || size < 1e-4) return x.toExponential(2).replace('-', '−');
  return String(Number(x.toPrecision(3))).replace('-', '−');
}

export const triple = (v) => v.map(figure).join(', ');
export const percent = (x) => `${(100 * x).toFixed(x > 0 && x < 0.0995 ? 1 : 0)}\u00a0%`;

const metres = (v) => `${v.map((x) => x.toFixed(2).replace('-', '−')).join(', ')} m`;
const direction = (v) => v.map((x) => x.toFixed(3).replace('-', '−')).join(', ');

// "plaster, phong, exponent 150".
export function materialWords({ name, kind, exponent, roughness, metallic, ior }) {
  const more = [
    exponent === undefined ? '' : `exponent ${figure(exponent)}`,
    roughness === undefined ? '' : `roughness ${figure(roughness)}`,
    metallic === undefined ? '' : `metallic ${figure(metallic)}`,
    ior === undefined ? '' : `index of refraction ${figure(ior)}`,
  ];
  return [name, kind, ...more].filter(Boolean).join(', ');
}

const SEES = {
  surface: 'a surface',
  mirror: 'a mirror',
  glass: 'glass',
  sky: 'the sky',
  nothing: 'nothing',
};

export function countSamples(answer) {
  const count = { generated: answer.light.length, chosen: 0, effective: 0, visible: 0 };
  for (const { kind } of answer.light.map(readSample)) {
    count.chosen += kind !== 'generated';
    count.effective += kind === 'effective' || kind === 'blocked';
    count.visible += kind === 'effective';
  }
  return count;
}

// One or two sentences that describe the drawing, for screen readers.
export function summary(answer) {
  const where = `Pixel ${answer.x}, ${answer.y} shows ${SEES[answer.sees]}`;
  if (!answer.point) {
    return answer.escape
      ? `${where}. It sees the sky directly, so no light is gathered.`
      : `${where}. It gathers no light from the sky.`;
  }
  const behind = answer.point.behind ? ', and a point seen in it' : '';
  const n = countSamples(answer);
  const shares = [...answer.shares].sort((a, b) => b.share - a.share).filter((s) => s.share >= 0.005).slice(0, 3);
  const most = shares.map((s) => `${s.face === 'sun' ? 'the sun' : s.face.replace('-', '−')}\u00a0${percent(s.share)}`).join(', ');
  return `${where}${behind}. Of ${n.generated} light samples ${n.chosen} were chosen for it, ${n.effective} are effective`
    + ` and ${n.visible} unblocked.${most ? ` Shares: ${most}.` : ''} ${percent(answer.point.open)} of the hemisphere above it is open sky.`;
}

// The table: [label, value, unit or remark].
export function rows(answer, unit = UNIT) {
  const all = [];
  const { point, pixel, first } = answer;
  if (answer.picture) all.push(['Radiance in the image', triple(answer.picture), `${unit}; all light`]);
  if (answer.lamps) all.push(['Of it by lamps', triple(answer.lamps.radiance), `${unit}; factor ${Number(answer.lamps.scale.toPrecision(3))}`]);
  if (pixel) {
    all.push([`From these ${answer.samples} samples`, triple(pixel.radiance), `${unit}; direct light and sky`]);
    all.push(['Converged', withError(pixel.reference), `${unit}; ${pixel.reference.estimates * 256} samples`]);
    all.push(...partRows(pixel.parts, unit));
    all.push(['Contains', madeOf(pixel), '']);
  }
  if (first && answer.sees !== 'surface') all.push(['First surface', materialWords(first.material), '']);
  if (point) {
    if (!pixel) all.push(['Here, with the preset', triple(point.radiance), unit]);
    if (!pixel) all.push(['Converged', withError(point.reference), `${unit}; ${point.reference.estimates * 256} samples`]);
    all.push(['Position', metres(point.position), 'x, y, z']);
    all.push(['Normal', direction(point.normal), '']);
    all.push(['Material', materialWords(point.material), answer.preset ? 'replaced by a Phong lobe' : '']);
    all.push(['Diffuse', triple(point.lobe.diffuse), 'red, green, blue']);
    if (point.lobe.specular) all.push(['Specular', triple(point.lobe.specular), lobeWords(point.lobe)]);
    all.push(['Open sky', percent(point.open), `of the hemisphere; ${percent(point.open_cosine)} cosine-weighted`]);
  }
  all.push(['Sky frame', String(answer.frame), `method ${answer.method}, ${answer.samples} samples`]);
  return all;
}

const duration = (hours) => `${Math.floor(Math.round(60 * hours) / 60)}\u00a0h ${Math.round(60 * hours) % 60}\u00a0min`;

// Of the day that the sky shows.
export const sunWords = ({ hours, daylight }) => `The sun can reach this point for ${duration(hours)} of the ${duration(daylight)} between sunrise and sunset.`;

// The day as a CSS gradient from midnight to midnight: the sun's share in steps, and the night.
export function sunGradient({ shares }, sun, shade, night) {
  const n = shares.length;
  const stops = [];
  for (let k = 0; k < n;) {
    let end = k + 1;
    while (end < n && shares[end] === shares[k]) end += 1;
    const colour = shares[k] === '-' ? night : `color-mix(in srgb, ${sun} ${Math.round((100 * shares[k]) / 9)}%, ${shade})`;
    stops.push(`${colour} ${((100 * k) / n).toFixed(2)}% ${((100 * end) / n).toFixed(2)}%`);
    k = end;
  }
  return `linear-gradient(90deg, ${stops.join(', ')})`;
}

const PARTS = { direct: 'Direct light', indirect: 'Indirect light', caustics: 'Caustics', background: 'Background' };

// What the server knows of the light by class; older ones send nothing.
function partRows(parts, unit) {
  return Object.entries(PARTS).filter(([name]) => parts?.[name])
    .map(([name, label]) => [label, percent(parts[name].share), `${withError(parts[name])} ${unit}`]);
}

const lobeWords = (lobe) => (lobe.exponent === undefined ? `alpha ${figure(lobe.alpha)}` : `exponent ${figure(lobe.exponent)}`);

function withError({ mean, error }) {
  return mean.map((m, i) => `${figure(m)}\u00a0±\u00a0${figure(error[i])}`).join(', ');
}

function madeOf({ points, escapes }) {
  const parts = [];
  if (points) parts.push(`${points} shade ${points === 1 ? 'point' : 'points'}`);
  if (escapes) parts.push(`${escapes} direct ${escapes === 1 ? 'view' : 'views'} of the sky`);
  return parts.join(', ') || 'nothing';
}

// The plot as text.
export function plotWords(points, unit = UNIT) {
  if (points.length < 2) return 'The plot of radiance over time grows with each image.';
  const values = points.map(({ rgb }) => luminance(rgb));
  const seconds = Math.round((points[points.length - 1].t - points[0].t) / 1000);
  const [least, most] = values.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  return `Over ${seconds} s the luminance went from ${figure(values[0])} to ${figure(values[values.length - 1])},`
    + ` between ${figure(least)} and ${figure(most)} ${unit}.`;
}
