// Times and errors of the images of the last minutes, and the latency from sky to screen by stage. Pure: headers, statuses and
// times are arguments.

import { FLAG_FINER, FLAG_REPEAT } from './js/protocol.js';
import { milliseconds } from './sentences.js';

export const MINUTES = 3;
const SPAN_MS = MINUTES * 60000;
const HEADERS = 400; // kept until a status refers to one of them
const CHOICES = 6; // listed

export const STAGES = [
  ['queued', 'Capture and wait'],
  ['decoded', 'Read sky'],
  ['shaded', 'Relight'],
  ['encoded', 'Encode'],
  ['shown', 'To screen'],
];

const isFiner = (header) => (header.flags & FLAG_FINER) !== 0;

// Latency from a frame's capture to its image on screen, ms by STAGES; NaN if the clock offset is unknown. nowUs: the server's
// clock when it was drawn.
export function latencyParts(header, nowUs) {
  const { queuedUs, decodedUs, shadedUs, encodedUs, captureUs, publishedUs } = header;
  const made = queuedUs + decodedUs + shadedUs + encodedUs;
  const before = captureUs > 0 ? Math.max(0, publishedUs - captureUs - made) : 0;
  return [before + queuedUs, decodedUs, shadedUs, encodedUs, Math.max(0, nowUs - publishedUs)].map((us) => us / 1000);
}

// The kind of a choice of estimators: without its counts, which change from image to image.
export const kindOf = ({ method, paths }) => `${method}|${paths}`.replace(/ \([^)]*\)/g, '').replace(/\d[\d.]*(e[-+]?\d+)?/g, '#');

export class Insight {
  constructor() {
    this.forget();
  }

  // Clears everything, for a new server or session.
  forget() {
    this.headers = [];
    this.points = []; // {t, frame, sequence, finer, passes, method, shadedMs, wholeMs, error or null, choice}
    this.choices = []; // {number, t, method, paths, leftOut}
    this.seconds = []; // {t, count, sums}: one per second
    this.told = 0; // number of choices so far
  }

  // Records a drawn image. nowUs: the server's clock, NaN if unknown.
  picture(header, nowUs, t) {
    this.headers.push({ header, t });
    if (this.headers.length > HEADERS) this.headers.shift();
    if (isFiner(header) || header.flags & FLAG_REPEAT || !Number.isFinite(nowUs)) return; // its age is not latency
    const second = Math.floor(t / 1000) * 1000;
    let last = this.seconds[this.seconds.length - 1];
    if (last?.t !== second) {
      last = { t: second, count: 0, sums: STAGES.map(() => 0) };
      this.seconds.push(last);
    }
    last.count++;
    latencyParts(header, nowUs).forEach((ms, i) => { last.sums[i] += ms; });
    while (this.seconds[0].t < t - SPAN_MS) this.seconds.shift();
  }

  // A status describes one image: method, error, what was left out. Adds a point if that image was drawn here.
  status(status, t) {
    const light = status.light;
    const finer = light?.passes > 0;
    const found = this.headers.findLast(({ header }) => header.frame === status.frame && isFiner(header) === finer);
    if (!light || !found || status.frames?.used === 0) return null; // no image yet
    const { header } = found;
    const before = this.points[this.points.length - 1];
    if (before?.frame === header.frame && before.finer === finer) {
      if (!finer) return null; // already recorded
      this.points.pop(); // for a still sky the newest refinement replaces the previous one
    }
    const us = header.queuedUs + header.decodedUs + header.shadedUs + header.encodedUs;
    const point = {
      t, frame: header.frame, sequence: header.sequence, finer, passes: light.passes ?? 0, method: status.method,
      shadedMs: header.shadedUs / 1000, wholeMs: us / 1000, error: light.error > 0 ? light.error : null,
      atMost: light.error_at_most > 0 ? light.error_at_most : null,
      samples: header.samples, paths: light.paths ?? '', leftOut: light.left_out ?? '',
    };
    this.choose(point, before, t);
    this.points.push(point);
    while (this.points[0].t < t - SPAN_MS) this.points.shift();
    return point;
  }

  choose(point, before, t) {
    const newest = this.choices[this.choices.length - 1];
    point.kind = kindOf(point);
    if (newest && newest.kind === point.kind) {
      point.choice = newest.number;
      Object.assign(newest, { paths: point.paths, leftOut: point.leftOut }); // with the latest counts
      return;
    }
    point.begins = true;
    point.choice = ++this.told;
    this.choices.push({ number: this.told, t, kind: point.kind, method: point.method, paths: point.paths, leftOut: point.leftOut });
    if (this.choices.length > CHOICES) this.choices.shift();
  }

  get last() {
    return this.points[this.points.length - 1] ?? null;
  }

  // Means of the last complete second, else of the current one: ms by STAGES.
  get latency() {
    const last = this.seconds[this.seconds.length - 2] ?? this.seconds[this.seconds.length - 1];
    return last ? last.sums.map((sum) => sum / last.count) : STAGES.map(() => NaN);
  }
}

// A logarithmic axis for all values, with ticks at powers of ten, and at 2 and 5 if these are few: {least, most, ticks}.
export function logAxis(values, usual) {
  const known = values.filter((v) => v > 0);
  const [low, high] = known.length ? [Math.min(...known), Math.max(...known)] : usual;
  const steps = (from, to) => {
    const all = [];
    for (let power = Math.floor(Math.log10(from)) - 1; power <= Math.log10(to) + 1; power++)
      for (const s of [1, 2, 5]) all.push(Number((s * 10 ** power).toPrecision(1)));
    return all;
  };
  const all = steps(low, high);
  const least = all.findLast((v) => v <= low * (1 + 1e-9));
  let most = all.find((v) => v >= high * (1 - 1e-9));
  if (most / least < 4.9) most = all.find((v) => v >= 4.9 * least); // a minimal range
  const within = all.filter((v) => v >= least && v <= most);
  const tens = within.filter((v) => /^(1|1e[-+]\d+|0\.0*1|10+)$/.test(String(v)));
  return { least, most, ticks: within.length > 6 && tens.length > 1 ? tens : within.length > 6 ? within.filter((v, i) => i % 2 === 0) : within };
}

export const errorText = (e) => (e > 0 ? e.toPrecision(2).replace('e-', 'e\u2212') : 'not estimated');
export const noiseText = (e) => (e > 0 ? `${Number((100 * Math.sqrt(e)).toPrecision(2))} %` : 'not estimated');

const boundText = (point, text) => (!point.error && point.atMost ? `at most ${text(point.atMost)}` : text(point.error));

// The plots as a table: pairs [label, value].
export function rows(insight) {
  const last = insight.last;
  const parts = insight.latency;
  const all = last
    ? [['Newest image', `frame ${last.frame}${last.finer ? `, ${last.passes} ${last.passes === 1 ? 'pass' : 'passes'}` : ''}`],
      ['Method', last.method], ['Relight', milliseconds(last.shadedMs)], ['Server total', milliseconds(last.wholeMs)],
      ['Error (relMSE)', boundText(last, errorText)], ['Noise', boundText(last, noiseText)]]
    : [];
  if (parts.some(Number.isFinite)) {
    STAGES.forEach(([, label], i) => all.push([`Latency: ${label.toLowerCase()}`, milliseconds(parts[i])]));
    all.push(['Latency: total', milliseconds(parts.reduce((a, b) => a + b, 0))]);
  }
  return all;
}

// One sentence for screen readers.
export function summary(insight, whole) {
  const { last, points } = insight;
  if (!last) return 'No image has been reported yet.';
  const time = milliseconds(whole ? last.wholeMs : last.shadedMs);
  const error = last.error ? `, noise about ${noiseText(last.error)}`
    : last.atMost ? `, noise at most ${noiseText(last.atMost)}` : '; its error is not known';
  return `The newest of ${points.length} images took ${time} with ${last.method}${error}.`;
}

export const choiceWords = (choice, nowT) => {
  const seconds = Math.max(0, Math.round((nowT - choice.t) / 1000));
  const ago = seconds < 90 ? `${seconds} s ago` : `${Math.round(seconds / 60)} min ago`;
  return `${choice.number}, ${ago}: ${choice.method}${choice.paths ? `: ${choice.paths}` : ''}.${choice.leftOut ? ` Left out: ${choice.leftOut}.` : ''}`;
};
