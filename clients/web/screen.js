// The canvas: draws the newest image before the browser paints, and closes skipped ones.

export class Screen {
  // Calls drawn(picture, nowMs) after each drawing.
  constructor(canvas, drawn) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d', { alpha: false, colorSpace: 'srgb' });
    this.drawn = drawn;
    this.waiting = null;
    this.asked = 0;
  }

  show(picture) {
    this.waiting?.bitmap.close();
    this.waiting = picture;
    if (!this.asked) this.asked = requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.asked = 0;
    const picture = this.waiting;
    this.waiting = null;
    if (!picture) return;
    // A video frame's sides may be one pixel longer than the image's.
    const { bitmap, header: { width, height } } = picture;
    // Setting the size clears the canvas, so only when it changes.
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
      document.documentElement.style.setProperty('--aspect', `${width} / ${height}`);
    }
    this.context.drawImage(bitmap, 0, 0);
    bitmap.close();
    this.drawn(picture, performance.timeOrigin + performance.now());
  }

  // The current pixels: {width, height, data: Uint8ClampedArray of RGBA, top row first}.
  readback() {
    return this.context.getImageData(0, 0, this.canvas.width, this.canvas.height);
  }
}
