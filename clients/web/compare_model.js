// What two compared pictures are, and how far they lie apart, in words and figures. Pure functions.

import { FLAG_FINER } from './protocol.js';

export const GAIN = 8; // of the difference that is drawn

// What is known of a picture: from its header, and from the last status, which may be half a second older or younger.
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

// Another status that may be about the same picture: where the two name different methods, both are said.
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

// What makes the two differ besides their methods.
export function warnings(a, b) {
  const all = [];
  if (a.camera !== b.camera) all.push('another camera');
  if (a.frame !== b.frame) all.push('another frame of the sky');
  const stops = a.gain > 0 && b.gain > 0 ? Math.log2(b.gain / a.gain) : 0;
  if (Math.abs(stops) >= 0.005) all.push(`exposed ${stops > 0 ? '+' : '\u2212'}${Math.abs(stops).toFixed(2)} stops`);
  return all;
}

// Of two pictures of RGBA code values of one size: the mean absolute difference of red, green and blue, and the value that
// 95 % of them do not pass.
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
  `differs by ${mean.toFixed(mean < 9.95 ? 2 : 0)} of 255 on average, 95 % by at most ${most}`;

export const within = (x) => Math.min(1, Math.max(0, x));
