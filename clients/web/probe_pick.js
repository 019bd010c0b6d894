// The crosshair over the image: chooses a pixel of the full-size image by a click, a tap or the arrow keys.

import { make } from './dom.js';
import { fit, pixelAt } from './probe_geometry.js';

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const LEAP = 10; // with Shift
const STILL_PX = 5; // more than this is a drag, not a click

export class Picker {
  // Calls chosen(x, y) after each choice.
  constructor(app, chosen) {
    this.canvas = app.canvas;
    this.view = app.canvas.parentElement;
    this.chosen = chosen;
    this.width = this.height = 0;
    this.at = null;
    this.said = make('span', { ariaLive: 'polite' });
    this.hair = make('div', { id: 'probe-hair', tabIndex: 0, role: 'application', ariaLabel: 'Pixel probe: move with the arrow keys, with Shift by ten; Enter shows where the light comes from' }, this.said);
    this.hair.dataset.keys = 'ArrowLeft ArrowRight ArrowUp ArrowDown Enter Escape';
    this.canvas.after(this.hair);
    this.listen(app);
  }

  listen(app) {
    let down = null;
    this.view.addEventListener('pointerdown', (event) => { down = [event.clientX, event.clientY]; });
    this.view.addEventListener('click', (event) => {
      const moved = down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) > STILL_PX;
      if (moved || (event.target !== this.canvas && event.target !== this.hair && event.target.id !== 'compare')) return;
      const pixel = this.width && pixelAt(this.box(), this.width, this.height, event.clientX, event.clientY);
      if (pixel) this.choose(pixel);
    });
    this.hair.addEventListener('keydown', (event) => this.pressed(event));
    this.hair.addEventListener('focus', () => {
      if (!this.at && this.width) this.mark({ x: this.width >> 1, y: this.height >> 1 });
      this.say();
    });
    new ResizeObserver(() => this.place()).observe(this.view);
    app.key('p', 'Pixel probe: choose a pixel with the arrow keys, then press Enter', () => this.hair.focus());
  }

  box() {
    return this.canvas.getBoundingClientRect();
  }

  // Size of the full image, pixels.
  setSize(width, height) {
    if (this.width === width && this.height === height) return;
    this.width = width;
    this.height = height;
    this.place();
  }

  pressed(event) {
    const step = STEPS[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === 'Escape') this.hair.blur();
    if (event.key === 'Enter' && this.at) this.choose(this.at);
    if (step && this.at) {
      const by = event.shiftKey ? LEAP : 1;
      const within = (v, most) => Math.min(most - 1, Math.max(0, v));
      this.mark({ x: within(this.at.x + by * step[0], this.width), y: within(this.at.y + by * step[1], this.height) });
      this.say();
    }
    if (step || event.key === 'Enter' || event.key === 'Escape') event.preventDefault();
  }

  choose(pixel) {
    this.mark(pixel);
    this.chosen(pixel.x, pixel.y);
  }

  say() {
    if (this.at) this.said.textContent = `pixel ${this.at.x}, ${this.at.y}`;
  }

  // null removes the mark.
  mark(pixel) {
    this.at = pixel;
    this.hair.classList.toggle('placed', pixel !== null);
    this.place();
  }

  place() {
    if (!this.at || !this.width) return;
    const box = this.box();
    const over = this.view.getBoundingClientRect();
    const { scale, left, top } = fit(box, this.width, this.height);
    this.hair.style.left = `${left - over.left + scale * (this.at.x + 0.5)}px`;
    this.hair.style.top = `${top - over.top + scale * (this.at.y + 0.5)}px`;
  }
}
