// The comparison: a divider with a kept image on its left and the live one on its right, all from canvas pixels.
// compare_model.js has the texts.

import { GAIN, alsoMethod, difference, differenceWords, factsOf, sideWords, warnings, within } from './compare_model.js';
import { make, setText, withKey } from './dom.js';
import { fit } from './probe_geometry.js';
import { topButton } from './snapshot.js';

const STEP = 0.01; // of the image's width per arrow key; LEAP with Shift
const LEAP = 0.1;
const FIGURES_MS = 1000;

export class Compare {
  constructor(app) {
    this.app = app;
    this.place = document.getElementById('compare');
    this.at = 0.5;
    this.kept = null; // {canvas, facts}
    this.header = null; // of the live image
    this.build();
    app.on('picture', ({ header }) => this.takePicture(header));
    app.on('status', (status) => this.takeStatus(status));
    new ResizeObserver(() => this.layOut()).observe(this.place);
    window.relight.compare = this;
  }

  build() {
    this.left = make('canvas', { id: 'compare-kept', ariaHidden: 'true' });
    this.handle = make('div', { id: 'compare-handle', tabIndex: 0, role: 'slider', ariaLabel: 'Divider between the kept image and the live one', ariaValueMin: '0', ariaValueMax: '100', ariaOrientation: 'horizontal' });
    this.handle.dataset.keys = 'ArrowLeft ArrowRight Home End';
    this.wordsA = make('p', { id: 'compare-a' });
    this.wordsB = make('p', { id: 'compare-b' });
    this.anew = make('button', { type: 'button', id: 'compare-anew', text: 'Keep the live image' });
    this.apart = make('button', { type: 'button', id: 'compare-difference', text: `Difference × ${GAIN}`, ariaPressed: 'false' });
    this.end = make('button', { type: 'button', id: 'compare-end', text: 'Close' });
    this.remark = make('span', { id: 'compare-remark' });
    this.bar = make('div', { id: 'compare-bar', role: 'group', ariaLabel: 'Comparison' }, this.remark,
      make('div', { className: 'compare-row' }, this.anew, this.apart, this.end));
    this.words = make('div', { id: 'compare-words' }, this.wordsA, this.wordsB);
    this.parts = [this.left, this.handle, this.words, this.bar];
    this.place.append(this.left, this.handle);
    document.getElementById('stage').append(this.words, this.bar); // over the image; on a phone below it
    this.show(false);

    this.button = topButton('compare-button', 'Keep this image and compare', 'Compare', 'M2 3h12v10H2zM8 1.5v13M5 8H3.8M11 8h1.2');
    this.button.setAttribute('aria-pressed', 'false');
    withKey(this.app, this.button, 'k', 'Compare: keep this image beside the live one, or stop', () => (this.kept ? this.stop() : this.keep()));
    this.anew.onclick = () => this.keep();
    this.end.onclick = () => this.stop();
    this.apart.onclick = () => this.toggle();
    this.app.key('x', `Compare: difference times ${GAIN}, or the kept image`, () => this.toggle());
    this.listen();
  }

  listen() {
    const move = (event) => {
      const { left, width } = this.box();
      this.set((event.clientX - left) / width);
    };
    this.handle.addEventListener('pointerdown', (event) => {
      if (event.button !== 0) return;
      this.handle.setPointerCapture(event.pointerId);
      this.handle.focus({ focusVisible: false });
      event.preventDefault();
    });
    this.handle.addEventListener('pointermove', (event) => {
      if (this.handle.hasPointerCapture(event.pointerId)) move(event);
    });
    this.handle.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const by = event.shiftKey ? LEAP : STEP;
      const to = { ArrowLeft: this.at - by, ArrowRight: this.at + by, Home: 0, End: 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      this.set(to);
    });
  }

  // ---- user actions

  keep() {
    if (!this.header) {
      this.app.say('There is no image yet');
      return;
    }
    const { width, height } = this.app.canvas;
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext('2d', { willReadFrequently: true }).drawImage(this.app.canvas, 0, 0);
    this.kept = { canvas, facts: factsOf(this.header, this.app.status), young: true };
    this.show(true);
    this.draw();
    this.app.say('Left: kept image. Right: live image.');
  }

  stop() {
    this.kept = null;
    this.show(false);
  }

  toggle() {
    if (!this.kept) {
      this.app.say('Keep an image first (K)');
      return;
    }
    this.apart.setAttribute('aria-pressed', String(!this.differs));
    this.draw();
  }

  get differs() {
    return this.apart.getAttribute('aria-pressed') === 'true';
  }

  set(at) {
    this.at = within(at);
    this.layOut();
  }

  // ---- events

  takePicture(header) {
    this.header = header;
    if (!this.kept) return;
    if (this.differs || header.width !== this.laidWidth || header.height !== this.laidHeight) this.draw();
    this.say();
  }

  takeStatus(status) {
    if (!this.kept) return;
    if (this.kept.young) { // the first status after the image was kept
      this.kept.facts = alsoMethod(this.kept.facts, status);
      this.kept.young = false;
    }
    this.say();
  }

  // ---- drawing

  show(on) {
    for (const element of this.parts) element.hidden = !on;
    document.body.classList.toggle('comparing', on);
    this.button?.setAttribute('aria-pressed', String(on));
  }

  // The image's rectangle in the window.
  box() {
    const over = this.place.getBoundingClientRect();
    const { width, height } = this.app.canvas;
    const { scale, left, top } = fit(over, width, height);
    return { left, top, width: scale * width, height: scale * height, over };
  }

  layOut() {
    if (!this.kept) return;
    const { left, top, width, height, over } = this.box();
    const place = (element, x, y, w, h) => Object.assign(element.style, { left: `${x}px`, top: `${y}px`, width: `${w}px`, height: `${h}px` });
    place(this.left, left - over.left, top - over.top, width, height);
    this.left.style.clipPath = `inset(0 ${(100 * (1 - this.at)).toFixed(3)}% 0 0)`;
    place(this.handle, left - over.left + this.at * width, top - over.top, 0, height);
    this.handle.setAttribute('aria-valuenow', String(Math.round(100 * this.at)));
    this.handle.setAttribute('aria-valuetext', `${Math.round(100 * this.at)} % of the width shows the kept image`);
  }

  // Draws the left side: the kept image, or GAIN times the absolute difference, capped at white.
  draw() {
    if (!this.kept) return;
    const { width, height } = this.app.canvas;
    [this.laidWidth, this.laidHeight] = [width, height];
    if (this.left.width !== width || this.left.height !== height) Object.assign(this.left, { width, height });
    const context = this.left.getContext('2d', { alpha: false });
    context.globalCompositeOperation = 'copy';
    context.drawImage(this.kept.canvas, 0, 0, width, height);
    if (this.differs) {
      context.globalCompositeOperation = 'difference';
      context.drawImage(this.app.canvas, 0, 0);
      context.globalCompositeOperation = 'lighter'; // doubles it
      for (let gain = 1; gain < GAIN; gain *= 2) context.drawImage(this.left, 0, 0);
    }
    this.layOut();
    this.say();
  }

  say() {
    if (!this.kept) return;
    const live = factsOf(this.header, this.app.status);
    setText(this.wordsA, sideWords(this.differs ? 'Difference from kept image' : 'Kept', this.kept.facts));
    setText(this.wordsB, sideWords('Live', live));
    setText(this.remark, [this.figures(), ...warnings(this.kept.facts, live)].filter(Boolean).join('; '));
  }

  // Reads through a second canvas: browsers move a canvas that is read often off the GPU.
  pixels(canvas) {
    const { width, height } = canvas;
    if (this.scratch?.width !== width || this.scratch?.height !== height) this.scratch = new OffscreenCanvas(width, height);
    const context = this.scratch.getContext('2d', { willReadFrequently: true, alpha: false });
    context.drawImage(canvas, 0, 0);
    return context.getImageData(0, 0, width, height);
  }

  // Reading pixels is slow, so only once a second, and only while the difference is shown.
  figures() {
    const { canvas } = this.kept;
    const now = performance.now();
    if (!this.differs || canvas.width !== this.app.canvas.width || canvas.height !== this.app.canvas.height) return '';
    if (this.kept.figuresFor === this.header.sequence || now - this.kept.figuresMs < FIGURES_MS) return this.kept.figures;
    const live = this.pixels(this.app.canvas);
    const kept = this.pixels(canvas);
    Object.assign(this.kept, { figuresMs: now, figuresFor: this.header.sequence, figures: differenceWords(difference(kept.data, live.data)) });
    return this.kept.figures;
  }
}

export function mount(app) {
  document.head.append(make('link', { rel: 'stylesheet', href: 'compare.css' }));
  return new Compare(app);
}
