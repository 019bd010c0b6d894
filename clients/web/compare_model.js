// Descriptions of two compared images and of their difference. Pure functions.

import { FLAG_FINER } from './js/protocol.js';

export const GAIN = 8; // amplification of the drawn difference

// The facts about an image, from its header and the last status, which may be half a second older or newer.
export function factsOf(header, status) {
  const finer = (header.flags & FLAG_FINER) !== 0;
  const of = status?.frame === header.frame;
  return {
    method: status?.method ?? '',
    samples: header.samples,
    frame: header.frame,
    gain: header.gain,
    camera: status?.camera ?? null,
    passes: finer && of ? (status?.light?.passes ?? null) : null,
    converged: finer && of && status?.light?.converged === true,
  };
}

// Adds the method of another status that may concern the same image: if they differ, both are named.
export function alsoMethod(facts, status) {
  const names = facts.method.split(' or ');
  if (!status?.method || names.includes(status.method)) return facts;
  return { ...facts, method: [...names, status.method].filter(Boolean).join(' or ') };
}

export function sideWords(name, facts) {
  const passes = facts.passes > 0
    ? `${facts.passes} ${facts.passes === 1 ? 'pass' : 'passes'}${facts.converged ? ', converged' : ''}` : '';
  const samples = facts.samples > 0 ? `${facts.samples} ${facts.samples === 1 ? 'sample' : 'samples'}` : '';
  return `${name}: ${[facts.method, samples, passes, `frame ${facts.frame}`].filter(Boolean).join(', ')}`;
}

// Other differences between the two images than the method.
export function warnings(a, b) {
  const all = [];
  if (a.camera !== b.camera) all.push('different camera');
  if (a.frame !== b.frame) all.push('different sky frame');
  const stops = a.gain > 0 && b.gain > 0 ? Math.log2(b.gain / a.gain) : 0;
  if (Math.abs(stops) >= 0.005) all.push(`exposure ${stops > 0 ? '+' : '\u2212'}${Math.abs(stops).toFixed(2)} EV`);
  return all;
}

// The mean absolute difference of red, green and blue of two RGBA images of one size, and its 95th percentile.
export function difference(a, b) {
  const histogram = new Uint32Array(256);
  for (let i = 0; i < a.length; i += 4)
    for (let c = 0; c < 3; c++) histogram[Math.abs(a[i + c] - b[i + c])]++;
  const count = (a.length / 4) * 3;
  let sum = 0;
  let below = 0;
  let most = -1;
  histogram.forEach((n, value) => {
    sum += n * value;
    below += n;
    if (most < 0 && below >= 0.95 * count) most = value;
  });
  return { mean: sum / count, most };
}

export const differenceWords = ({ mean, most }) =>
  `mean difference ${mean.toFixed(mean < 9.95 ? 2 : 0)} of 255, 95th percentile ${most}`;

export const within = (x) => Math.min(1, Math.max(0, x));
