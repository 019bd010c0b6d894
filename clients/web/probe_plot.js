// A pixel's radiance over the last minutes: red, green and blue lines on an axis from 0.

import { begin, line } from './dom.js';
import { UNIT, figure } from './probe_words.js';

export const MINUTES = 3;
const MOST = 6000; // points: three minutes at 30 a second

export class Trace {
  constructor() {
    this.points = [];
  }

  clear() {
    this.points.length = 0;
  }

  // A refined image of the same frame replaces the previous point.
  add(t, rgb, frame, finer = false) {
    const last = this.points[this.points.length - 1];
    if (finer && last?.finer && last.frame === frame) this.points.pop();
    this.points.push({ t, rgb, frame, finer });
    const since = t - MINUTES * 60000;
    while (this.points.length > MOST || (this.points.length && this.points[0].t < since)) this.points.shift();
  }
}

// The smallest round number of at least x: 1, 2 or 5 times a power of ten.
export function roundUp(x) {
  if (!(x > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(x));
  const step = [1, 2, 5, 10].find((s) => s * power >= x * (1 - 1e-9));
  return step * power;
}

export function drawTrace(canvas, points, colours) {
  const { context, unit, width, height } = begin(canvas);
  const left = 4 * unit;
  const bottom = 16 * unit;
  const top = 15 * unit;
  const most = roundUp(Math.max(0, ...points.flatMap((p) => p.rgb)));
  const end = points.length ? points[points.length - 1].t : 0;
  const span = Math.max(10000, points.length ? end - points[0].t : 0);
  const x = (t) => left + (width - 2 * left) * (1 - (end - t) / span);
  const y = (v) => height - bottom - ((height - bottom - top) * v) / most;
  context.strokeStyle = colours.line;
  context.fillStyle = colours.text;
  for (const level of [0, 0.5, 1].map((part) => Math.round(y(part * most)) + 0.5))
    line(context, [left, level], [width - left, level]);
  context.fillText(`${figure(most)} ${UNIT}`, left, top - 4 * unit);
  context.fillText(`${Math.round(span / 1000)} s ago`, left, height - 4 * unit);
  context.textAlign = 'right';
  context.fillText('now', width - left, height - 4 * unit);
  context.lineWidth = 1.6 * unit;
  context.lineJoin = 'round';
  colours.rgb.forEach((colour, c) => {
    context.strokeStyle = colour;
    context.setLineDash([[], [6 * unit, 3 * unit], [2 * unit, 2 * unit]][c]);
    line(context, ...points.map((p) => [x(p.t), y(p.rgb[c])]));
  });
}
