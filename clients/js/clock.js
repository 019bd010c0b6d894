// The server's clock: uses the shortest of the last twenty round trips, since its asymmetry bounds the error.
export class ServerClock {
  constructor(count = 20) {
    this.count = count;
    this.trips = [];
  }

  add(sentUs, serverUs, receivedUs) {
    const rttUs = receivedUs - sentUs;
    if (!(rttUs >= 0)) return;
    this.trips.push({ rttUs, offsetUs: serverUs - (sentUs + receivedUs) / 2 });
    if (this.trips.length > this.count) this.trips.shift();
  }

  get best() {
    return this.trips.reduce((a, b) => (!a || b.rttUs < a.rttUs ? b : a), null);
  }

  get known() {
    return this.trips.length > 0;
  }

  // Server time minus local time, microseconds.
  get offsetUs() {
    return this.best ? this.best.offsetUs : 0;
  }

  // The offset is accurate to plus or minus this.
  get uncertaintyUs() {
    return this.best ? this.best.rttUs / 2 : Infinity;
  }

  get rttUs() {
    return this.trips.length ? this.trips[this.trips.length - 1].rttUs : NaN;
  }
}
