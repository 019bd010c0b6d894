// How long pictures took and how right they are, over the last minutes, and where the time between a sky and its picture on
// the screen went. Pure: headers, statuses and times are handed in.

import { FLAG_FINER, FLAG_REPEAT } from './protocol.js';

export const MINUTES = 3;
const SPAN_MS = MINUTES * 60000;
const HEADERS = 400; // kept until a status tells of one of them
const CHOICES = 6; // told in words

export const STAGES = [
  ['queued', 'Capture and wait'],
  ['decoded', 'Read sky'],
  ['shaded', 'Relight'],
  ['encoded', 'Encode'],
  ['shown', 'To screen'],
];

const isFiner = (header) => (header.flags & FLAG_FINER) !== 0;

// The parts of the time between a frame's capture and its picture on the screen, ms, in the order of STAGES; NaN where
// the clocks are not known to each other. nowUs: the server's clock when it was drawn.
export function latencyParts(header, nowUs) {
  const { queuedUs, decodedUs, shadedUs, encodedUs, captureUs, publishedUs } = header;
  const made = queuedUs + decodedUs + shadedUs + encodedUs;
  const before = captureUs > 0 ? Math.max(0, publishedUs - captureUs - made) : 0;
  return [before + queuedUs, decodedUs, shadedUs, encodedUs, Math.max(0, nowUs - publishedUs)].map((us) => us / 1000);
}

// What a choice of estimators is, without its counts, which change from picture to picture.
export const kindOf = ({ method, paths }) => `${method}|${paths}`.replace(/ \([^)]*\)/g, '').replace(/\d[\d.]*(e[-+]?\d+)?/g, '#');

export class Insight {
  constructor() {
    this.forget();
  }

  // Of another server or session nothing is known.
  forget() {
    this.headers = [];
    this.points = []; // {t, frame, sequence, finer, passes, method, shadedMs, wholeMs, error or null, choice}
    this.choices = []; // {number, t, method, paths, leftOut}
    this.seconds = []; // {t, count, sums}: of one second each
    this.told = 0; // choices in all
  }

  // A picture was drawn. nowUs: on the server's clock, NaN where that is not known.
  picture(header, nowUs, t) {
    this.headers.push({ header, t });
    if (this.headers.length > HEADERS) this.headers.shift();
    if (isFiner(header) || header.flags & FLAG_REPEAT || !Number.isFinite(nowUs)) return; // its age is not the way's
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

  // The status tells of one picture: its method, what was left out, its error. A point where that picture was drawn here.
  status(status, t) {
    const light = status.light;
    const finer = light?.passes > 0;
    const found = this.headers.findLast(({ header }) => header.frame === status.frame && isFiner(header) === finer);
    if (!light || !found || status.frames?.used === 0) return null; // of none yet
    const { header } = found;
    const before = this.points[this.points.length - 1];
    if (before?.frame === header.frame && before.finer === finer) {
      if (!finer) return null; // told already
      this.points.pop(); // of a still sky the newest takes the place of the one before
    }
    const us = header.queuedUs + header.decodedUs + header.shadedUs + header.encodedUs;
    const point = {
      t, frame: header.frame, sequence: header.sequence, finer, passes: light.passes ?? 0, method: status.method,
      shadedMs: header.shadedUs / 1000, wholeMs: us / 1000, error: light.error > 0 ? light.error : null,
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
      Object.assign(newest, { paths: point.paths, leftOut: point.leftOut }); // its counts as they are by now
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

  // The means of the last second that is over, or of the one that is not: ms by STAGES.
  get latency() {
    const last = this.seconds[this.seconds.length - 2] ?? this.seconds[this.seconds.length - 1];
    return last ? last.sums.map((sum) => sum / last.count) : STAGES.map(() => NaN);
  }
}

// Powers of ten, with 2 and 5 where these are few, that hold all values: {least, most, ticks}.
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
  if (most / least < 4.9) most = all.find((v) => v >= 4.9 * least); // not a line
  const within = all.filter((v) => v >= least && v <= most);
  const tens = within.filter((v) => /^(1|1e[-+]\d+|0\.0*1|10+)$/.test(String(v)));
  return { least, most, ticks: within.length > 6 && tens.length > 1 ? tens : within.length > 6 ? within.filter((v, i) => i % 2 === 0) : within };
}

const ms = (x) => (Number.isFinite(x) ? `${x < 9.95 ? x.toFixed(1) : Math.round(x)} ms` : '–');
export const errorText = (e) => (e > 0 ? e.toPrecision(2).replace('e-', 'e\u2212') : 'not estimated');
export const noiseText = (e) => (e > 0 ? `${Number((100 * Math.sqrt(e)).toPrecision(2))} %` : 'not estimated');

// The table that says what the drawings show: [label, value] each.
export function rows(insight) {
  const last = insight.last;
  const parts = insight.latency;
  const all = last
    ? [['Newest picture', `frame ${last.frame}${last.finer ? `, ${last.passes} ${last.passes === 1 ? 'pass' : 'passes'}` : ''}`],
      ['Method', last.method], ['Relight', ms(last.shadedMs)], ['Server, in all', ms(last.wholeMs)],
      ['Error (relMSE)', errorText(last.error)], ['Noise', noiseText(last.error)]]
    : [];
  if (parts.some(Number.isFinite)) {
    STAGES.forEach(([, label], i) => all.push([`Latency: ${label.toLowerCase()}`, ms(parts[i])]));
    all.push(['Latency, in all', ms(parts.reduce((a, b) => a + b, 0))]);
  }
  return all;
}

// One sentence for who does not see the drawing.
export function summary(insight, whole) {
  const { last, points } = insight;
  if (!last) return 'No picture has been told about yet.';
  const time = ms(whole ? last.wholeMs : last.shadedMs);
  const error = last.error ? `, noise about ${noiseText(last.error)}` : ', its error is not estimated by this method';
  return `The newest of ${points.length} pictures took ${time} by ${last.method}${error}.`;
}

export const choiceWords = (choice, nowT) => {
  const seconds = Math.max(0, Math.round((nowT - choice.t) / 1000));
  const ago = seconds < 90 ? `${seconds} s ago` : `${Math.round(seconds / 60)} min ago`;
  return `${choice.number}, ${ago}: ${choice.method}${choice.paths ? `: ${choice.paths}` : ''}.${choice.leftOut ? ` Left out: ${choice.leftOut}.` : ''}`;
};
