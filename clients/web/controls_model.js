// The controls without the page: pure functions and one small queue, for tests.

import { dayText } from './daylight_model.js';
import { betweenSentence } from './sentences.js';

// A queue of setting changes: keeps the newest of each kind and sends it when the previous request is answered.
export class Wishes {
  // send({op: 'control', request, ...wish}); a request without an answer is abandoned after `patience` milliseconds.
  constructor(send, nowMs = () => performance.now(), patience = 2000) {
    this.send = send;
    this.nowMs = nowMs;
    this.patience = patience;
    this.request = 0;
    this.forget();
  }

  forget() {
    this.waiting = null; // not sent yet
    this.underway = null; // sent, without an answer
    this.sentMs = 0;
  }

  ask(wish) {
    this.waiting = join(this.waiting ?? {}, wish);
    if (!this.underway || this.nowMs() - this.sentMs > this.patience) this.flush();
  }

  flush() {
    this.underway = this.waiting;
    this.waiting = null;
    if (!this.underway) return;
    this.sentMs = this.nowMs();
    this.send({ op: 'control', request: ++this.request, ...this.underway });
  }

  // Handles an answer or a refusal. True if it belongs to the pending request.
  answered(request) {
    if (!this.underway || request !== this.request) return false;
    this.flush();
    return true;
  }

  // Age of the pending request in ms; 0: none.
  get waitedMs() {
    return this.underway ? this.nowMs() - this.sentMs : 0;
  }

  // The current settings overlaid with pending changes, so that a control does not jump back and forth.
  over(control) {
    return { ...control, ...this.underway, ...this.waiting };
  }
}

// Merges changes as the server does (PROTOCOL.md 4.13): a position discards earlier steps; samples and error replace each
// other.
export function join(before, wish) {
  const all = { ...before, ...wish };
  const placed = [wish.seek, wish.hour, wish.day].some((v) => v !== undefined);
  if (placed && wish.step === undefined) delete all.step;
  if (wish.seek !== undefined) delete all.hour;
  if (wish.seek !== undefined) delete all.day;
  if (wish.hour !== undefined || wish.day !== undefined) delete all.seek;
  if (!placed && wish.step !== undefined) all.step = (before.step ?? 0) + wish.step;
  if (wish.samples > 0) delete all.error;
  if (wish.error > 0) delete all.samples;
  return all;
}

export const wrapDegrees = (d) => ((((d + 180) % 360) + 360) % 360) - 180;
export const wrapHour = (h) => ((h % 24) + 24) % 24;

export const degreesText = (d) => `${Math.round(wrapDegrees(d))}°`;
export const stopsText = (s) => `${s > 0 ? '+' : s < 0 ? '−' : ''}${Math.abs(s).toFixed(1)} EV`;

// The slider of the lamps' factor: stops of it, and off at its lower end.
export const LAMPS = { least: -20, most: 10 };
export const lampsOf = (stops) => (stops <= LAMPS.least ? 0 : Number((2 ** stops).toPrecision(6)));
export const stopsOfLamps = (lamps) => (lamps > 0 ? Math.max(LAMPS.least, Math.min(LAMPS.most, Math.log2(lamps))) : LAMPS.least);
export const lampsText = (lamps) => (lamps > 0 ? `\u00d7\u2009${Number(lamps.toPrecision(2))}` : 'off');

export function hourText(hour) {
  const minutes = Math.floor(wrapHour(hour) * 60 + 1e-6) % 1440; // guard against rounding below a full hour
  return `${String(Math.floor(minutes / 60)).padStart(2, '0')}:${String(minutes % 60).padStart(2, '0')}`;
}

// Noise targets as a share of the image's light, and the relMSE that the protocol uses.
export const NOISES = [0.01, 0.02, 0.05, 0.1, 0.2];
export const noiseOf = (error) => Math.sqrt(error);
export const errorOf = (noise) => Number((noise * noise).toPrecision(6));
export const noiseText = (noise) => `${Number((100 * noise).toPrecision(2))} %`;

export const SAMPLES = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024];
export const RATES = [1, 2, 5, 10, 15, 20, 24, 30, 60];

// The next choice, cyclic; for a value that is not a choice, the first above it.
export function next(choices, now, by = 1) {
  const at = choices.indexOf(now);
  if (at >= 0) return choices[(at + by + choices.length) % choices.length];
  const above = choices.findIndex((choice) => choice > now);
  return by > 0 ? choices[above < 0 ? 0 : above] : choices[above < 0 ? choices.length - 1 : Math.max(0, above - 1)];
}

// The choices plus the current value, if it is not one of them.
export function withPresent(choices, now) {
  if (now === undefined || now === null || choices.includes(now)) return choices;
  return typeof now === 'number' ? [...choices, now].sort((a, b) => a - b) : [...choices, now];
}

// The source's abilities: {play, step, scrub: null | {least, most, step, value}, text}.
export function transportOf(status) {
  const source = status?.source ?? {};
  const { kind, position, length, hour } = source;
  const none = { play: false, step: false, scrub: null, text: '' };
  if (kind === undefined) return none; // a server of minor version 0
  if (kind === 'sky' && typeof hour === 'number')
    return { play: true, step: true, scrub: { least: 0, most: 24, step: 1 / 12, value: hour }, text: hourText(hour) };
  if (kind === 'daylight' && source.day > 0)
    return { play: true, step: true, scrub: { least: 0, most: 24, step: 0.25, value: hour }, day: source.day, text: `${dayText(source.day)}, ${hourText(hour)}` };
  if ((kind === 'files' || kind === 'daylight' || kind === 'sky') && length > 1)
    return { play: true, step: true, scrub: { least: 0, most: length - 1, step: 1, value: position }, text: `${position + 1} of ${length}` };
  if (kind === 'sky') return { ...none, play: true }; // its hour is known with its first image
  if (kind === 'files' && length === null) return { ...none, play: true, step: true }; // a video that does not state its length
  if (kind === 'files' || kind === 'daylight') return { ...none, text: 'A single sky.' };
  return { ...none, play: true, text: (kind === 'folder' ? 'Frames arrive as files are stored.' : 'Frames arrive as they are sent.') + betweenSentence(source) };
}

// The request for one frame forward or back, or for a leap of an hour or ten frames, on a paused source.
export function stepWish(status, by, leap) {
  const { kind, length } = status?.source ?? {};
  const { hour } = status?.source ?? {};
  if (leap && kind === 'sky' && typeof hour === 'number') return { paused: true, hour: wrapHour(hour + by) };
  return { paused: true, step: leap ? by * Math.min(10, Math.max(1, (length ?? 11) - 1)) : by };
}

const NAMES = {
  rotate_degrees: ['the sky\u2019s rotation', degreesText],
  scale_stops: ['the sky\u2019s brightness', stopsText],
  method: ['the method', String],
  samples: ['the samples', String],
  error: ['the target noise', (e) => (e ? noiseText(noiseOf(e)) : 'none')],
  fps: ['the frame rate limit', String],
  tone: ['the tone curve', String],
  exposure_stops: ['the exposure', (s) => (typeof s === 'number' ? stopsText(s) : s ?? 'follow')],
  bias_stops: ['the exposure compensation', stopsText],
  paths: ['the light', String],
  lamps: ['the lamps', lampsText],
  camera: ['the camera', (c) => (c.startsWith('@') ? 'a free view' : c)],
  paused: ['time', (p) => (p ? 'paused' : 'running')],
};

// The differences between two sets of settings, in words; '' if none is shown.
export function changesText(before, after) {
  return Object.entries(NAMES)
    .filter(([key]) => after[key] !== undefined && before[key] !== after[key])
    .map(([key, [name, text]]) => `${name}: ${text(after[key])}`)
    .join(', ');
}
