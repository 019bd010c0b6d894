// `?from=hls`: the page without a connection to relightd. Shows `hls/live.m3u8` beside the page, which nginx or a CDN serves, in a
// <video> in place of the canvas.

import { make } from './dom.js';
import { HlsPlayer } from './hls_player.js';

const NAME = 'hls/live.m3u8';

// canvas: the element to replace. show(state): several times a second. drawn(): after each image. Returns the function that takes
// the page's commands.
export function watchHls(canvas, { show, drawn, relight }) {
  const video = make('video', {
    id: canvas.id, muted: true, playsInline: true, ariaLabel: canvas.getAttribute('aria-label'), attributes: { role: 'img' },
  });
  canvas.replaceWith(video);
  const player = new HlsPlayer(video, new URL(NAME, document.baseURI).href, NAME);

  const frame = () => {
    relight.frames++;
    drawn(video);
    if (video.requestVideoFrameCallback) video.requestVideoFrameCallback(frame);
  };
  if (video.requestVideoFrameCallback) video.requestVideoFrameCallback(frame);
  else video.addEventListener('timeupdate', frame);
  video.addEventListener('resize', () => {
    document.documentElement.style.setProperty('--aspect', `${video.videoWidth} / ${video.videoHeight}`);
  });
  video.addEventListener('click', () => player.press());

  relight.player = player;
  relight.readback = () => readback(video);
  setInterval(() => show(player.state(relight.frames > 0)), 250);
  player.hide(document.visibilityState === 'hidden');
  player.run();
  return (message) => {
    if (message.op === 'hidden') player.hide(message.hidden);
    if (message.op === 'retry') player.wake();
  };
}

// The image on screen: {width, height, data: Uint8ClampedArray of RGBA, top row first}.
function readback(video) {
  const { videoWidth: width, videoHeight: height } = video;
  const context = new OffscreenCanvas(width, height).getContext('2d');
  context.drawImage(video, 0, 0);
  return context.getImageData(0, 0, width, height);
}
