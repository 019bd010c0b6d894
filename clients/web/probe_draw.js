// The sky with a probe's samples, as lat-long image and cube cross, in the colours of Fig. 1 of Lu, Pacanowski and Granier 2013:
// red generated, yellow chosen, green effective, cyan the normal. Each mark has its own shape too.

import { begin, line } from './dom.js';
import { fromCross, fromLatLong, luminance, readSample, sightAt, toCross, toLatLong } from './probe_geometry.js';

export const COLOURS = {
  generated: '#ff5a4f',
  chosen: '#ffd23f',
  blocked: '#ffd23f',
  effective: '#4be07c',
  lobe: '#7cc4ff',
  normal: '#2ee6ff',
};
const INK = '#07090c';

// Decodes the sky's image: {width, height, data} of RGBA.
export async function decodeSky({ jpeg }) {
  const bytes = Uint8Array.from(atob(jpeg), (c) => c.charCodeAt(0));
  const bitmap = await createImageBitmap(new Blob([bytes], { type: 'image/jpeg' }));
  const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
  const context = canvas.getContext('2d', { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return context.getImageData(0, 0, canvas.width, canvas.height);
}

// Both drawings: width and height in units, and the mapping of directions.
const VIEWS = {
  latlong: {
    width: 2,
    height: 1,
    from: (x, y) => fromLatLong(x / 2, y),
    to: (w) => {
      const { u, v } = toLatLong(w);
      return { x: 2 * u, y: v };
    },
  },
  cross: { width: 4, height: 3, from: fromCross, to: toCross },
};

// Fills the canvas with the sky; directions below the surface dark, blocked ones hatched.
function paintSky(context, view, sky, visibility) {
  const { width, height } = context.canvas;
  const image = context.createImageData(width, height);
  for (let j = 0; j < height; j++) {
    for (let i = 0; i < width; i++) {
      const w = view.from(((i + 0.5) / width) * view.width, ((j + 0.5) / height) * view.height);
      if (!w) continue;
      const at = 4 * (j * width + i);
      const { u, v } = toLatLong(w);
      const from = sky
        ? 4 * (Math.min(sky.height - 1, Math.floor(v * sky.height)) * sky.width + Math.min(sky.width - 1, Math.floor(u * sky.width)))
        : -1;
      const sight = visibility ? sightAt(visibility, w) : '.';
      let part = 1;
      if (sight === '-') part = 0.22;
      if (sight === '#') part = (i + j) % 6 < 2 ? 0.12 : 0.45;
      for (let c = 0; c < 3; c++) image.data[at + c] = part * (from >= 0 ? sky.data[from + c] : 90);
      image.data[at + 3] = 255;
    }
  }
  context.putImageData(image, 0, 0);
}

function disc(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
}

// Radius by contribution: area proportional to its share of the largest.
function radiusOf(sample, largest, unit) {
  const share = largest > 0 ? luminance(sample.rgb) / largest : 0;
  return unit * (1.6 + 3.4 * Math.sqrt(share));
}

function mark(context, sample, x, y, unit, largest) {
  const colour = sample.lobe ? COLOURS.lobe : COLOURS[sample.kind];
  context.lineWidth = 1.1 * unit;
  context.strokeStyle = context.fillStyle = colour;
  if (sample.kind === 'generated') {
    context.globalAlpha = 0.75;
    disc(context, x, y, 1.4 * unit);
    context.fill();
    context.globalAlpha = 1;
  } else if (sample.lobe) {
    const r = sample.kind === 'effective' ? radiusOf(sample, largest, unit) : 2.2 * unit;
    context.beginPath();
    context.moveTo(x, y - r);
    context.lineTo(x + r, y + 0.8 * r);
    context.lineTo(x - r, y + 0.8 * r);
    context.closePath();
    if (sample.kind === 'effective') context.fill();
    else context.stroke();
  } else if (sample.kind === 'effective') {
    disc(context, x, y, radiusOf(sample, largest, unit));
    context.fill();
    context.strokeStyle = INK;
    context.lineWidth = 0.8 * unit;
    context.stroke();
  } else {
    disc(context, x, y, 2.4 * unit);
    context.stroke();
    if (sample.kind === 'blocked') {
      const r = 1.7 * unit;
      line(context, [x - r, y - r], [x + r, y + r]);
      line(context, [x + r, y - r], [x - r, y + r]);
    }
  }
}

function markNormal(context, x, y, unit) {
  const r = 4 * unit;
  context.beginPath();
  context.moveTo(x, y - r);
  context.lineTo(x + r, y);
  context.lineTo(x, y + r);
  context.lineTo(x - r, y);
  context.closePath();
  context.fillStyle = COLOURS.normal;
  context.fill();
  context.strokeStyle = INK;
  context.lineWidth = unit;
  context.stroke();
}

const ORDER = ['generated', 'chosen', 'blocked', 'effective'];

// Draws `answer` on the canvas at its displayed size; sky: from decodeSky, or null; show: {visibility, lobes}.
export function drawProbe(canvas, name, answer, sky, show) {
  const view = VIEWS[name];
  const { context, unit } = begin(canvas, (width) => (width * view.height) / view.width);
  paintSky(context, view, sky, show.visibility ? answer.point?.visibility : null);
  const samples = answer.light.map(readSample);
  if (show.lobes) samples.push(...answer.lobes.map((s) => ({ ...readSample(s), lobe: true })));
  const largest = Math.max(0, ...samples.map((s) => (s.kind === 'effective' ? luminance(s.rgb) : 0)));
  const place = (w) => {
    const { x, y } = view.to(w);
    return [(x / view.width) * canvas.width, (y / view.height) * canvas.height];
  };
  for (const kind of ORDER)
    for (const s of samples)
      if (s.kind === kind) mark(context, s, ...place(s.w), unit, largest);
  if (answer.point) markNormal(context, ...place(answer.point.normal), unit);
  else if (answer.escape) markNormal(context, ...place(answer.escape), unit);
}
