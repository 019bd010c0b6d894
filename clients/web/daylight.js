// The daylight panel, for sources with dates (a weather file): the legend of false colour, the luminance below the pointer, and the
// illuminance of the probed surface over the year. controls_time.js has the date's scale, sky_panel.js the sun's path.

import { begin, colours, make, setText } from './dom.js';
import { isSeen } from './panels.js';
import { luminance, pixelAt } from './probe_geometry.js';
import { FALSE_COLOUR, MONTH_DAYS, Year, amount, dayText, falseColour, illuminanceFactor, legend, perUnit, placeOfFrame } from './daylight_model.js';

const REST_MS = 150; // the pointer rests before its pixel is asked for
const LOST_MS = 5000;
const SHOW_MS = 500;

class Daylight {
  constructor(app) {
    this.app = app;
    this.year = new Year();
    this.gain = 0;
    this.request = 0;
    this.askedMs = -Infinity;
    this.factor = null; // lux per radiance times 1 / perUnit; null: luminance is shown
    this.measured = null; // the pixel of the year
    app.on('status', (status) => this.take(status));
    app.on('picture', ({ header }) => { this.gain = header.gain; });
    app.on('probed', (answer) => this.takeProbed(answer));
    app.on('radiance', (message) => this.takeRadiance(message));
    app.on('welcome', () => { this.waiting = false; });
    app.canvas.parentElement.addEventListener('pointermove', (event) => this.pointed(event));
    app.canvas.parentElement.addEventListener('pointerleave', () => { clearTimeout(this.timer); if (this.built) setText(this.under, this.hint()); });
    setInterval(() => this.show(), SHOW_MS);
    window.relight.daylight = this;
  }

  // The panel appears with the first status of such a source.
  take(status) {
    this.place = status.place ?? null;
    if (!this.place) return;
    if (!this.built) this.build(this.app.panel('daylight', 'Daylight'));
    setText(this.when, `${dayText(status.source.day)}, ${status.light?.sun ? `sun at ${status.light.sun.elevation.toFixed(0)}°` : 'no sun'}; `
      + `${Math.abs(this.place.latitude).toFixed(1)}° ${this.place.latitude < 0 ? 'S' : 'N'}`);
  }

  build(body) {
    this.built = true;
    this.when = make('p', { className: 'counts', id: 'daylight-when' });
    this.under = make('p', { className: 'counts', id: 'daylight-under', text: this.hint() });
    this.colour = make('input', { type: 'checkbox', id: 'daylight-colour' });
    this.colour.onchange = () => window.relight.controls.ask({ tone: this.colour.checked ? FALSE_COLOUR : 'filmic' });
    this.ramp = make('canvas', { id: 'daylight-ramp', attributes: { role: 'img' } });
    this.map = make('canvas', { id: 'daylight-year', attributes: { role: 'img' } });
    this.words = make('p', { className: 'counts', id: 'daylight-words' });
    this.clear = make('button', { type: 'button', text: 'Start again' });
    this.clear.onclick = () => this.year.forget();
    body.append(this.when, make('label', { className: 'toggle' }, this.colour, ' False colour'), this.ramp, this.under,
      make('h3', { text: 'The probed pixel over the year' }), this.map, this.words, this.clear);
  }

  hint() {
    return 'Rest the pointer on the image for its luminance.';
  }

  get unit() {
    return perUnit(this.place, this.app.control?.scale_stops ?? 0);
  }

  // ---- below the pointer

  pointed({ clientX, clientY }) {
    clearTimeout(this.timer);
    if (!this.built || !this.place || !isSeen(this.under)) return;
    this.timer = setTimeout(() => this.ask(clientX, clientY), REST_MS);
  }

  ask(clientX, clientY) {
    const { width, height } = this.app.status;
    const pixel = pixelAt(this.app.canvas.getBoundingClientRect(), width, height, clientX, clientY);
    if (!pixel || (this.waiting && performance.now() - this.askedMs < LOST_MS)) return;
    this.waiting = true;
    this.askedMs = performance.now();
    this.request = Math.max(Date.now(), this.request + 1);
    this.app.send({ op: 'probe', request: this.request, ...pixel, samples: 1 });
  }

  takeProbed(answer) {
    if (answer.x === undefined || !this.built || !this.place) return;
    if (answer.request === this.request) {
      this.waiting = false;
      if (answer.picture) setText(this.under, `Pixel ${answer.x}, ${answer.y}: ${amount(luminance(answer.picture) * this.unit)} cd/m²`);
    }
    const { pixel } = this.app;
    if (!pixel || answer.x !== pixel.x || answer.y !== pixel.y) return;
    const factor = illuminanceFactor(answer);
    if (this.measured?.x === pixel.x && this.measured.y === pixel.y && this.factor === factor) return;
    this.measured = { ...pixel };
    this.factor = factor;
    this.year.forget();
  }

  // ---- over the year

  takeRadiance({ x, y, frame, radiance }) {
    const { status } = this.app;
    if (!this.place || x !== this.measured?.x || y !== this.measured.y || !(status?.source?.day > 0)) return;
    const { day, hour } = placeOfFrame(frame, { frame: status.frame, day: status.source.day, hour: status.source.hour });
    this.year.add(day, hour, luminance(radiance) * this.unit * (this.factor ?? 1));
  }

  // ---- drawing

  show() {
    if (!this.built || !this.place || !isSeen(this.ramp)) return;
    this.colour.checked = window.relight.controls.now.tone === FALSE_COLOUR; // also while the server has not answered yet
    this.colour.disabled = this.app.role !== 'controller';
    this.drawRamp();
    this.drawYear();
  }

  drawRamp() {
    const { context, unit, width, height } = begin(this.ramp);
    const colour = colours();
    const marks = this.gain > 0 ? legend(this.gain, this.unit) : [];
    for (let x = 0; x < width; x++) {
      context.fillStyle = falseColour(x / (width - 1));
      context.fillRect(x, 0, 1, height - 18 * unit);
    }
    context.fillStyle = colour('--soft');
    context.textAlign = 'center';
    let free = 0;
    for (const [share, value] of marks) {
      const text = amount(value);
      const half = context.measureText(text).width / 2;
      const x = Math.min(width - half, Math.max(half, share * width));
      if (x - half < free) continue;
      free = x + half + 6 * unit;
      context.fillText(text, x, height - 5 * unit);
    }
    this.ramp.setAttribute('aria-label', `Colours of luminance, from ${amount(marks[0]?.[1])} to ${amount(marks.at(-1)?.[1])} cd/m²`);
  }

  drawYear() {
    const { context, unit, width, height } = begin(this.map);
    const colour = colours();
    const [left, bottom] = [26 * unit, 16 * unit];
    const [wide, tall] = [width - left, height - bottom];
    context.fillStyle = colour('--surround');
    context.fillRect(left, 0, wide, tall);
    const { top } = this.year;
    for (const [at, value] of this.year.values) {
      const [day, hour] = [Math.floor(at / 24), at % 24];
      const x = left + Math.floor((day * wide) / 365);
      const y = Math.floor(((23 - hour) * tall) / 24);
      context.fillStyle = falseColour(value / top);
      context.fillRect(x, y, Math.max(1, left + Math.floor(((day + 1) * wide) / 365) - x), Math.max(1, Math.floor(((24 - hour) * tall) / 24) - y));
    }
    context.fillStyle = colour('--soft');
    context.textAlign = 'right';
    for (const hour of [0, 6, 12, 18, 24]) context.fillText(String(hour), left - 4 * unit, Math.min(tall, Math.max(9 * unit, ((24 - hour) * tall) / 24 + 4 * unit)));
    context.textAlign = 'center';
    let day = 0;
    MONTH_DAYS.forEach((days, month) => {
      context.fillText('JFMAMJJASOND'[month], left + ((day + days / 2) * wide) / 365, height - 4 * unit);
      day += days;
    });
    const what = this.factor === null ? 'luminance, cd/m²' : 'illuminance of this matte surface, lx';
    const words = !this.app.pixel ? 'Click the image to choose a place, then let time run: each image adds its hour.'
      : `Pixel ${this.app.pixel.x}, ${this.app.pixel.y}: ${what}; ${this.year.values.size} hours so far, ${this.year.values.size ? `up to ${amount(this.year.most)}; colours from 0 to ${amount(top)}` : 'let time run'}.`;
    setText(this.words, words);
    this.map.setAttribute('aria-label', `Days of the year to the right, hours upwards. ${words}`);
  }
}

export function mount(app) {
  document.head.append(make('link', { rel: 'stylesheet', href: 'daylight.css' }));
  return new Daylight(app);
}
