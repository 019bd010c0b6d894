// The sky panel: the environment map as a lat-long image with the sun marked and, while a pixel is probed, that pixel's light
// samples. Requests the sky once a second while the panel is visible; probe answers include it.

import { sunPath } from './daylight_model.js';
import { line, make } from './dom.js';
import { decodeSky, drawProbe } from './probe_draw.js';
import { toLatLong } from './probe_geometry.js';
import { isSeen } from './panels.js';
import { betweenSentence, sunSentence } from './sentences.js';

const ASK_MS = 1000;
const LOST_MS = 10000;

// Unit vector towards the sun from its elevation and its azimuth clockwise from north in degrees (north +Z, east -X), in a sky
// rotated right-handed about +Y.
export function sunDirection({ elevation, azimuth }, turnDegrees = 0) {
  const [up, round, turn] = [elevation, azimuth, turnDegrees].map((d) => (d * Math.PI) / 180);
  const [x, z] = [-Math.cos(up) * Math.sin(round), Math.cos(up) * Math.cos(round)];
  return [x * Math.cos(turn) + z * Math.sin(turn), Math.sin(up), z * Math.cos(turn) - x * Math.sin(turn)];
}

const NONE = { light: [], lobes: [], point: null, escape: null };

class SkyPanel {
  constructor(app) {
    this.app = app;
    this.request = 0;
    this.waiting = false;
    this.refused = false; // an older server
    this.sky = null; // {frame, image, turn}
    this.probed = null; // the last probe answer
    this.probedMs = -Infinity;
    this.build(app.panel('sky-panel', 'The sky'));
    app.on('probed', (message) => this.take(message));
    app.on('error', (error) => this.takeError(error));
    app.on('welcome', () => { this.waiting = this.refused = false; });
    app.on('status', () => this.say());
    setInterval(() => this.ask(), ASK_MS);
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    window.relight.sky = this;
  }

  build(body) {
    this.canvas = make('canvas', { id: 'sky-latlong', attributes: { role: 'img' } });
    this.words = make('p', { className: 'counts', id: 'sky-words', text: 'The sky appears with the first image.' });
    body.append(this.canvas, this.words);
  }

  get seen() {
    return isSeen(this.canvas);
  }

  // The probed pixel, if any.
  get pixel() {
    return this.app.pixel ? this.probed : null;
  }

  ask() {
    const now = performance.now();
    if (this.waiting && now - this.askedMs > LOST_MS) this.waiting = false;
    if (!this.pixel && this.probed) {
      this.probed = null;
      this.draw();
    }
    if (!this.seen || this.waiting || this.refused || !(this.app.status?.frames?.used > 0) || now - this.probedMs < 1.5 * ASK_MS) return;
    if (this.fresh()) return;
    this.waiting = true;
    this.askedMs = now;
    this.app.send({ op: 'probe', request: ++this.request, sky: true });
  }

  // Whether the sky is unchanged: a still sky is requested once.
  fresh() {
    return this.sky?.alone && this.sky.frame === this.app.status.frame && this.sky.turn === (this.app.control?.rotate_degrees ?? this.sky.turn);
  }

  async take(message) {
    const alone = message.x === undefined;
    const { pixel } = this.app;
    if (alone ? message.request !== this.request : !pixel || message.x !== pixel.x || message.y !== pixel.y) return;
    if (alone) this.waiting = false;
    else {
      this.probed = message;
      this.probedMs = performance.now();
    }
    if (message.sky) {
      const image = await decodeSky(message.sky);
      this.sky = { image, alone, frame: message.frame, turn: message.rotate_degrees ?? this.app.control?.rotate_degrees ?? 0 };
    }
    this.draw();
    this.say();
  }

  takeError(error) {
    if (error.request !== this.request || !error.clause?.startsWith('4.15')) {
      if (error.code !== 'unknown_op' || !this.waiting) return;
    }
    this.waiting = false;
    this.refused = error.code === 'unknown_op' || error.code === 'bad_field';
    if (this.refused) this.words.textContent = 'This server does not send its sky.';
  }

  // The sun's direction in the drawn sky, [x, y, z], or null.
  get sun() {
    const sun = this.app.status?.light?.sun;
    return sun && this.sky ? this.towards(sun) : null;
  }

  draw() {
    if (!this.sky || !this.seen) return;
    const answer = this.pixel ?? NONE;
    drawProbe(this.canvas, 'latlong', answer, this.sky.image, { visibility: false, lobes: false });
    this.drawPaths();
    const { sun } = this;
    if (!sun) return;
    const { u, v } = toLatLong(sun);
    for (const round of [-1, 0, 1]) this.markSun(u + round, v); // a mark at one edge continues at the other
  }

  // The direction of a sun in the drawn sky; a weather file may turn north.
  towards({ elevation, azimuth }) {
    return sunDirection({ elevation, azimuth: azimuth + (this.app.status?.place?.north ?? 0) }, this.sky.turn);
  }

  // The sun's way on this day, and thinner on the longest and the shortest, of a weather file.
  drawPaths() {
    const { place, source } = this.app.status ?? {};
    if (!place) return;
    const unit = Math.max(1, window.devicePixelRatio);
    const context = this.canvas.getContext('2d');
    const [width, height] = [this.canvas.width, this.canvas.height];
    for (const [day, bold] of [[172, false], [355, false], [source.day, true]]) {
      context.strokeStyle = bold ? '#ffd34d' : '#ffd34d80';
      context.lineWidth = (bold ? 2 : 1) * unit;
      let before = null;
      for (const at of sunPath(place, day)) {
        const { u, v } = toLatLong(this.towards(at));
        if (before && Math.abs(u - before[0]) < 0.5) line(context, [before[0] * width, before[1] * height], [u * width, v * height]);
        if (bold && at.hour % 3 === 0) context.strokeRect(u * width - unit, v * height - unit, 2 * unit, 2 * unit);
        before = [u, v];
      }
    }
  }

  markSun(u, v) {
    const unit = Math.max(1, window.devicePixelRatio);
    const context = this.canvas.getContext('2d');
    for (const [colour, width] of [['#000c', 4], ['#fff', 2]]) {
      context.strokeStyle = colour;
      context.lineWidth = width * unit;
      for (let turn = 0; turn < 4; turn++) { // four strokes around the sun leave it visible
        const [c, s] = [Math.cos((turn * Math.PI) / 2), Math.sin((turn * Math.PI) / 2)];
        line(context, ...[6, 13].map((r) => [u * this.canvas.width + r * unit * c, v * this.canvas.height + r * unit * s]));
      }
    }
  }

  say() {
    if (!this.sky) return;
    const sun = sunSentence(this.app.status?.light, Boolean(this.app.status?.place));
    const { pixel } = this;
    const marks = pixel ? ` Marked: the ${pixel.light.length} light samples of pixel ${pixel.x}, ${pixel.y}.` : '';
    const turn = Math.round(this.sky.turn);
    const words = `Frame ${this.sky.frame}${turn ? `, rotated by ${turn}°` : ''}; the middle is +Z (north unless it is turned).${sun ? ` ${sun[0].toUpperCase()}${sun.slice(1)}; four strokes mark it.` : ''}${betweenSentence(this.app.status?.source)}${marks}`;
    if (this.words.textContent === words) return;
    this.words.textContent = words;
    this.canvas.setAttribute('aria-label', `The sky as a lat-long image. ${words}`);
  }
}

export function mount(app) {
  return new SkyPanel(app);
}
