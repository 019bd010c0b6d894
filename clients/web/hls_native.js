// Plays HLS with the browser's own player: Safari, and where MediaSource cannot, Chromium from 142 on.

export const canPlayNatively = (video) => video.canPlayType('application/vnd.apple.mpegurl') !== '';

export class HlsNative {
  constructor(video) {
    this.video = video;
  }

  async open(url) {
    this.video.src = url;
  }

  close() {
    this.video.removeAttribute('src');
    this.video.load();
  }

  async take() {} // it reads the playlist itself

  end() {
    const { buffered, currentTime } = this.video;
    return buffered.length ? buffered.end(buffered.length - 1) : currentTime;
  }

  shownDate() {
    const began = this.video.getStartDate?.().getTime(); // Safari's
    return Number.isFinite(began) ? began + 1000 * this.video.currentTime : NaN;
  }
}
