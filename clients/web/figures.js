// Running statistics: rates and medians. Pure state machines; times are arguments.

// Events per second over the last `windowMs`, from the spacing of the events in it.
export class Rate {
  constructor(windowMs = 2000) {
    this.windowMs = windowMs;
    this.times = [];
    this.sizes = [];
  }

  add(nowMs, size = 0) {
    this.times.push(nowMs);
    this.sizes.push(size);
    this.forget(nowMs);
  }

  forget(nowMs) {
    while (this.times.length && this.times[0] < nowMs - this.windowMs) {
      this.times.shift();
      this.sizes.shift();
    }
  }

  perSecond(nowMs) {
    this.forget(nowMs);
    const n = this.times.length;
    if (n < 2) return 0;
    // A pause counts once it is longer than the usual spacing.
    const spacing = (this.times[n - 1] - this.times[0]) / (n - 1);
    const until = Math.max(this.times[n - 1], nowMs - spacing);
    return ((n - 1) * 1000) / Math.max(until - this.times[0], 1e-3);
  }

  bytesPerSecond(nowMs) {
    const n = this.times.length;
    if (n < 2) return 0;
    const mean = this.sizes.reduce((a, b) => a + b, 0) / n;
    return mean * this.perSecond(nowMs);
  }
}

// The last `count` values and their median.
export class Recent {
  constructor(count = 60) {
    this.count = count;
    this.values = [];
  }

  add(value) {
    this.values.push(value);
    if (this.values.length > this.count) this.values.shift();
  }

  clear() {
    this.values.length = 0;
  }

  median() {
    if (!this.values.length) return NaN;
    const sorted = [...this.values].sort((a, b) => a - b);
    const half = sorted.length >> 1;
    return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
  }
}
