// The two plots of insight.js, on canvases at their displayed size.

import { begin, colours, line } from './dom.js';
import { MINUTES, STAGES, logAxis } from './insight_model.js';
import { roundUp } from './probe_plot.js';

// A shape and a colour per method, in order of appearance: no two methods share both.
const FORMS = ['disc', 'square', 'triangle', 'diamond', 'cross'];
export const COLOURS = ['--sun', '--sky', '--good', '--violet', '--bad'];
export const styleOf = (index) => ({ form: FORMS[index % FORMS.length], colour: COLOURS[(index + Math.floor(index / FORMS.length)) % COLOURS.length] });
export const STAGE_COLOURS = ['--grey', '--sky', '--sun', '--violet', '--good'];

export function drawForm(context, form, x, y, r) {
  context.beginPath();
  if (form === 'disc') context.arc(x, y, r, 0, 2 * Math.PI);
  else if (form === 'square') context.rect(x - 0.85 * r, y - 0.85 * r, 1.7 * r, 1.7 * r);
  else if (form === 'cross') {
    context.moveTo(x - r, y - r);
    context.lineTo(x + r, y + r);
    context.moveTo(x + r, y - r);
    context.lineTo(x - r, y + r);
  } else {
    const low = form === 'triangle' ? [[x + r, y + 0.8 * r], [x - r, y + 0.8 * r]] : [[x + r, y], [x, y + r], [x - r, y]];
    context.moveTo(x, y - r);
    for (const p of low) context.lineTo(...p);
    context.closePath();
  }
}

const tickText = (v) => (v >= 0.001 && v < 1e5 ? String(v) : v.toExponential(0).replace('e-', 'e\u2212').replace('e+', 'e'));

const timeText = (v) => (v >= 1000 ? `${v / 1000} s` : v > 0 ? `${v} ms` : '0');

// The layout of the first plot: {x(ms), y(error), none: y of points without an error, ..}, in canvas pixels.
export function scatterPlaces(points, whole, { width, height, unit }) {
  const time = (p) => (whole ? p.wholeMs : p.shadedMs);
  const xs = logAxis(points.map(time), [10, 100]);
  const ys = logAxis(points.map((p) => p.error), [0.001, 0.1]);
  const [left, right, top, bottom] = [44 * unit, width - 18 * unit, 38 * unit, height - 30 * unit];
  const part = (v, { least, most }) => Math.log(v / least) / Math.log(most / least);
  return {
    xs, ys, left, right, top, bottom, none: 20 * unit, time,
    x: (v) => left + (right - left) * part(Math.max(v, xs.least), xs),
    y: (v) => bottom - (bottom - top) * part(v, ys),
  };
}

// Plots each image's error against its time: older ones paler, refinements of a still sky hollow, the newest with a ring.
export function drawScatter(canvas, insight, methods, whole) {
  const frame = begin(canvas);
  const { context, unit, height } = frame;
  const colour = colours();
  const at = scatterPlaces(insight.points, whole, frame);
  context.strokeStyle = colour('--line');
  context.fillStyle = colour('--soft');
  context.textAlign = 'center';
  for (const v of at.xs.ticks) {
    const x = Math.round(at.x(v)) + 0.5;
    line(context, [x, at.top], [x, at.bottom]);
    context.fillText(tickText(v), x, at.bottom + 13 * unit);
  }
  context.fillText(whole ? 'server total, ms' : 'relighting, ms', (at.left + at.right) / 2, height - 4 * unit);
  context.textAlign = 'right';
  for (const v of at.ys.ticks) {
    const y = Math.round(at.y(v)) + 0.5;
    line(context, [at.left, y], [at.right, y]);
    context.fillText(tickText(v), at.left - 4 * unit, y + 4 * unit);
  }
  context.textAlign = 'left';
  context.fillText('error (relMSE)', 2 * unit, 10 * unit);
  if (insight.points.some((p) => !p.error)) context.fillText('unknown', 2 * unit, at.none + 6 * unit);
  const now = insight.last?.t ?? 0;
  for (const p of insight.points) {
    const { form, colour: name } = styleOf(methods.indexOf(p.method));
    const [x, y] = [at.x(at.time(p)), p.error ? at.y(p.error) : at.none];
    context.globalAlpha = p === insight.last ? 1 : Math.max(0.3, 0.9 - (0.6 * (now - p.t)) / (MINUTES * 60000));
    context.fillStyle = context.strokeStyle = colour(name);
    context.lineWidth = 1.6 * unit;
    drawForm(context, form, x, y, 3.6 * unit);
    if (p.finer || form === 'cross') context.stroke();
    else context.fill();
    context.globalAlpha = 1;
    context.fillStyle = context.strokeStyle = colour('--text');
    if (p.begins) context.fillText(String(p.choice), x + 5 * unit, y - 4 * unit);
    if (p !== insight.last) continue;
    context.beginPath();
    context.arc(x, y, 7 * unit, 0, 2 * Math.PI);
    context.stroke();
  }
}

// Plots latency over time as stacked stages, from MINUTES ago on the left to now on the right.
export function drawLatency(canvas, seconds, t) {
  const { context, unit, width, height } = begin(canvas);
  const colour = colours();
  const means = seconds.map((s) => s.sums.map((sum) => sum / s.count));
  const totals = means.map((m) => m.reduce((a, b) => a + b, 0));
  const sorted = [...totals].sort((a, b) => a - b);
  const usual = sorted[Math.floor(0.98 * (sorted.length - 1))] ?? 0; // one stall must not flatten the rest
  const most = roundUp(Math.max(usual, 1));
  const span = Math.min(MINUTES * 60000, Math.max(20000, t - (seconds[0]?.t ?? t)));
  const [left, right, top, bottom] = [44 * unit, width - 4 * unit, 8 * unit, height - 18 * unit];
  const x = (time) => Math.max(left, right - ((right - left) * (t - time)) / span);
  const y = (v) => bottom - ((bottom - top) * Math.min(v, most)) / most;
  means.forEach((parts, i) => {
    const [from, to] = [x(seconds[i].t), x(Math.min(t, seconds[i].t + 1000))];
    let sum = 0;
    parts.forEach((part, k) => {
      context.fillStyle = colour(STAGE_COLOURS[k]);
      context.fillRect(from, y(sum + part), Math.max(1, to - from), y(sum) - y(sum + part));
      sum += part;
    });
  });
  context.strokeStyle = colour('--line');
  context.fillStyle = colour('--soft');
  for (const part of [0, 0.5, 1]) {
    const level = Math.round(y(part * most)) + 0.5;
    line(context, [left, level], [right, level]);
    context.textAlign = 'right';
    context.fillText(timeText(part * most), left - 3 * unit, level + 4 * unit);
  }
  context.textAlign = 'left';
  context.fillText(`${Math.round(span / 1000)} s ago`, left, height - 4 * unit);
  context.textAlign = 'right';
  context.fillText('now', right, height - 4 * unit);
}

export const stageLabels = STAGES.map(([, label]) => label);
