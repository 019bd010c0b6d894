// Plays segments of fragmented MP4 with MediaSource, which Firefox has, too, and which tells what is on screen.
// Segments are placed one behind another, whatever their time stamps say, so a publisher that restarts at zero does no harm.

import { HlsFault, isFragment, typeOf } from './hls_playlist.js';

const AHEAD = 1.5; // segments in the buffer after a new one: one to last until the next, and what that may be late
const FASTER = 1.06; // to catch up
const KEEP_S = 20; // of what was played

export const canBuffer = () => Boolean(globalThis.MediaSource);

export class HlsBuffer {
  // load(url, cache) resolves to a Uint8Array.
  constructor(video, load) {
    this.video = video;
    this.load = load;
    this.last = null; // the newest segment that was loaded
    this.begun = false; // has jumped near the end of what was listed at first
    this.placed = []; // {start, end: in the video's time, date}
  }

  async open() {
    this.source = new MediaSource();
    this.address = URL.createObjectURL(this.source);
    const opened = new Promise((resolve) => { this.source.addEventListener('sourceopen', resolve, { once: true }); });
    this.video.src = this.address;
    await opened;
  }

  close() {
    this.video.removeAttribute('src');
    this.video.load();
    if (this.address) URL.revokeObjectURL(this.address);
  }

  // Whether the publisher numbers its segments anew.
  isRestarted({ segments }) {
    if (!this.last || !segments.length) return false;
    const same = segments.find(({ sequence }) => sequence === this.last.sequence);
    return same ? same.url !== this.last.url : segments.at(-1).sequence < this.last.sequence;
  }

  // Loads what is new in the playlist, at most two segments.
  async take(list) {
    const restarted = this.isRestarted(list);
    const fresh = list.segments.filter(({ sequence }) => restarted || !this.last || sequence > this.last.sequence);
    let anew = restarted;
    for (const segment of fresh.slice(-2)) {
      const skipped = this.last && segment.sequence !== this.last.sequence + 1;
      const begins = !this.last || anew || segment.broken || segment.map !== this.last.map;
      this.last = segment; // a segment that cannot be had is passed over the next time
      if (begins) await this.begin(segment.map);
      anew = false;
      await this.place(segment, begins || skipped);
    }
    if (fresh.length) this.keepUp(fresh.at(-1).seconds || list.target);
  }

  async begin(map) {
    const init = await this.load(map, 'no-cache'); // its name may stay the same after a restart
    const type = typeOf(init);
    if (!type) throw new HlsFault('is not H.264');
    if (!MediaSource.isTypeSupported(type)) throw new HlsFault(`is ${type}, which this browser does not play`);
    if (this.buffer) {
      this.buffer.changeType(type);
    } else {
      this.source.duration = Infinity;
      this.buffer = this.source.addSourceBuffer(type);
    }
    this.buffer.mode = 'sequence';
    await this.update(() => this.buffer.appendBuffer(init));
  }

  end() {
    const { buffered } = this.buffer ?? {};
    return buffered?.length ? buffered.end(buffered.length - 1) : 0;
  }

  async place(segment) {
    const bytes = await this.load(segment.url, 'default');
    if (!isFragment(bytes)) throw Object.assign(new HlsFault('is no fragmented MP4'), { file: segment.url });
    const start = this.end();
    await this.update(() => this.buffer.appendBuffer(bytes));
    this.placed.push({ start, end: this.end(), date: segment.date });
    const old = this.video.currentTime - KEEP_S;
    if (old > this.buffer.buffered.start(0) + KEEP_S) {
      await this.update(() => this.buffer.remove(0, old));
      this.placed = this.placed.filter(({ end }) => end > old);
    }
  }

  update(act) {
    return new Promise((resolve, reject) => {
      this.buffer.onupdateend = resolve;
      this.buffer.onerror = () => reject(new HlsFault('cannot be decoded by this browser'));
      act();
    });
  }

  // After new segments: jumps at the beginning and if much is waiting, else plays a little faster if need be.
  keepUp(seconds) {
    const { video } = this;
    const ahead = this.end() - video.currentTime;
    if (!this.begun || ahead > (AHEAD + 2.5) * seconds) video.currentTime = Math.max(video.currentTime, this.end() - AHEAD * seconds);
    this.begun = true;
    video.playbackRate = ahead > (AHEAD + 0.35) * seconds ? FASTER : 1;
  }

  // When the image on screen was recorded, in ms since 1970; NaN: not stated.
  shownDate() {
    const t = this.video.currentTime;
    const at = this.placed.find(({ start, end }) => t >= start && t < end) ?? this.placed.at(-1);
    return at ? at.date + 1000 * (t - at.start) : NaN;
  }
}
