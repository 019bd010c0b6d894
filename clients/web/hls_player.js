// Follows one live HLS stream: reads the playlist, plays it with MediaSource or the browser's own player, and says what is wrong.

import { HlsBuffer, canBuffer } from './hls_buffer.js';
import { HlsNative, canPlayNatively } from './hls_native.js';
import { HlsFault, parsePlaylist, patience } from './hls_playlist.js';

const FETCH_MS = 15000;
const STUCK_S = 10; // of a video that stands still though there are new segments
const CLOCK_MS = 2000; // what two clocks may differ before the server's counts

export class HlsPlayer {
  // url: the playlist; name: how messages call it.
  constructor(video, url, name) {
    Object.assign(this, { video, url, name });
    this.engine = null;
    this.newest = null; // names the playlist's newest segment
    this.changedMs = this.movedMs = 0; // when it changed, and when the video last moved
    this.fault = null; // {said, untilMs}
    this.ended = false;
    this.target = 1;
    this.skewMs = 0; // server's clock - ours
    this.failures = 0;
    this.wake = () => {};
    video.addEventListener('error', () => { this.broken = true; });
    video.addEventListener('timeupdate', () => { this.movedMs = performance.now(); });
  }

  async run() {
    for (;;) {
      let waitS = 60;
      try {
        if (!this.hidden) waitS = await this.step();
        this.fault = null;
        this.failures = 0;
      } catch (error) {
        if (this.hidden) continue; // it was interrupted
        waitS = Math.min(5, 2 ** this.failures++);
        this.fault = { said: this.say(error), untilMs: performance.timeOrigin + performance.now() + 1000 * waitS };
        if (!(error instanceof HlsFault)) console.warn(error);
      }
      await new Promise((resolve) => {
        const timer = setTimeout(resolve, 1000 * waitS);
        this.wake = () => { clearTimeout(timer); resolve(); };
      });
    }
  }

  // Stops loading while the page is hidden, and begins at the newest image when it is seen again.
  hide(hidden) {
    if (hidden === this.hidden) return;
    this.hidden = hidden;
    if (hidden) this.stop();
    this.wake();
  }

  stop() {
    this.engine?.close();
    this.engine = null;
    this.broken = false;
  }

  // Reads the playlist once; returns when to do so again, in seconds.
  async step() {
    const list = await this.readPlaylist();
    const now = performance.now();
    const newest = list.segments.at(-1);
    const key = newest ? `${newest.sequence} ${newest.url}` : '';
    const changed = key !== this.newest;
    if (changed && (this.ended || this.isStalled(now))) this.movedMs = now; // it had nothing to play
    if (changed) this.changedMs = now - (this.newest === null ? this.ageMs(newest) : 0);
    this.newest = key;
    this.target = list.target;
    this.ended = list.ended;
    if (this.broken || (this.engine && changed && this.stuckS(now) > Math.max(STUCK_S, 4 * list.target))) {
      const why = this.video.error?.message;
      this.stop();
      throw new HlsFault(why ? `cannot be played by this browser: ${why}` : 'does not play');
    }
    if (newest && !this.hidden) await this.play(list, now);
    return changed && newest ? Math.max(0.2, 0.7 * newest.seconds) : Math.max(0.2, (this.isStalled(now) ? 1 : 0.25) * list.target);
  }

  // Since when a stream may have stood still that we see for the first time.
  ageMs(newest) {
    const age = Date.now() + this.skewMs - (newest?.date + 1000 * newest?.seconds);
    return age > 0 ? age : 0;
  }

  async play(list, now) {
    if (!this.engine) {
      this.engine = this.choose(list);
      this.movedMs = now;
      await this.engine.open(this.url);
    }
    await this.engine.take(list);
    if (this.video.paused && !this.refused) this.video.play().catch((error) => { this.refused = error.name === 'NotAllowedError'; });
  }

  // The user has pressed the image.
  press() {
    this.refused = false;
    if (this.engine) this.video.play().catch(() => {});
  }

  // Safari's own player knows dates, too.
  choose(list) {
    const native = canPlayNatively(this.video);
    if (native && this.video.getStartDate) return new HlsNative(this.video);
    if (list.plain && canBuffer()) return new HlsBuffer(this.video, (url, cache) => this.fetchBytes(url, cache));
    if (native) return new HlsNative(this.video);
    throw new HlsFault(list.plain ? 'needs a browser with MediaSource or HLS' : 'is not fragmented MP4, and this browser plays no other HLS');
  }

  async readPlaylist(url = this.url, depth = 0) {
    const answer = await this.fetch(url, 'no-store');
    const date = Date.parse(answer.headers.get('date')) + 1000 * (Number(answer.headers.get('age')) || 0) + 500;
    if (Number.isFinite(date)) this.skewMs = Math.abs(date - Date.now()) > CLOCK_MS ? date - Date.now() : 0;
    const list = parsePlaylist(await answer.text(), answer.url || url);
    if (!list.variant) return list;
    if (depth > 1) throw new HlsFault('names only other playlists');
    return this.readPlaylist(list.variant, depth + 1);
  }

  async fetchBytes(url, cache) {
    return new Uint8Array(await (await this.fetch(url, cache)).arrayBuffer());
  }

  async fetch(url, cache) {
    const answer = await fetch(url, { cache, signal: AbortSignal.timeout(FETCH_MS) });
    if (answer.ok) return answer;
    await answer.body?.cancel();
    throw Object.assign(new HlsFault('is refused'), { status: answer.status, file: url === this.url ? null : url });
  }

  isStalled(now = performance.now()) {
    return now - this.changedMs > 1000 * patience(this.target);
  }

  // How long the image has stood still.
  stuckS(now = performance.now()) {
    return (now - this.movedMs) / 1000;
  }

  // A sentence on a fault.
  say(error) {
    const file = error.file ? `The segment ${error.file.replace(/^.*\//, '')} of ${this.name}` : this.name;
    if (error.status === 404)
      return error.file ? `${file} is missing (404).` : `There is no stream at ${file} (404): nothing is being published there.`;
    if (error.status === 401 || error.status === 403) return `The server does not allow ${file} (${error.status}).`;
    if (error.status) return `The server answers ${error.status} for ${file}.`;
    if (error instanceof HlsFault) return `${file} ${error.message}.`;
    return `The server of ${file} does not answer.`;
  }

  // How old the image on screen is, in ms: by the playlist's dates or, without, by what was loaded since.
  delayMs() {
    if (!this.engine) return NaN;
    const date = this.engine.shownDate();
    if (Number.isFinite(date)) return Math.max(0, Date.now() + this.skewMs - date);
    return Math.max(0, 1000 * (this.engine.end() - this.video.currentTime) + performance.now() - this.changedMs);
  }

  // As the page's states (sentences.js); seen: an image is on screen.
  state(seen) {
    if (this.hidden) return { name: 'paused', detail: 'hidden' };
    if (this.fault) return { name: 'reconnecting', detail: this.fault.said, untilMs: this.fault.untilMs };
    if (this.refused) return { name: 'paused', detail: 'press' };
    const sinceMs = performance.now() - this.changedMs;
    if (this.ended) return { name: 'ended', detail: 'publishing' };
    if (this.newest !== null && this.isStalled()) return { name: 'stalled', published: true, seconds: Math.round(sinceMs / 1000) };
    if (!seen || this.newest === null) return { name: 'connecting', detail: 'stream' };
    if (this.engine && this.stuckS() > patience(this.target)) return { name: 'stalled', slow: true, seconds: Math.round(this.stuckS()) };
    return { name: 'live', delayMs: this.delayMs() };
  }
}
