// The page's sentences: pure functions of its state, for tests.

// Capitalises words, but not file names.
const capital = (text) => (/\s/.test(text) ? text[0].toUpperCase() + text.slice(1) : text);

// The last part of a path: the page does not show the server's folders.
const plain = (text) => text?.replace(/\/+$/, '').replace(/^.*\//, '');

// The same for paths in a reason such as "folder/a.exr: byte 3: torn": the text before the first colon, which may have
// blanks, and every other path that begins with a slash or a dot.
export const withoutFolders = (text) => (text || '')
  .replace(/^(watch:)?[^:'"]*\/(?=[^/:]+: )/, '$1')
  .replace(/(^|[\s'":=(])\.{0,2}\/(?!\/)(?:[^\s:'"/]+\/)*/g, '$1');

// The scene and its settings: "The built-in scene under a computed sky; 640 × 360, 64 samples per point, method mis." Samples
// and method are unknown before the first image.
export function describe(status) {
  if (!status) return '';
  const what = capital(plain(status.scene) || 'a scene');
  const sky = status.sky ? ` under ${plain(status.sky)}` : '';
  const size = status.width && status.height ? `${status.width}\u00a0×\u00a0${status.height}` : '';
  const made = status.frames?.used !== 0;
  const samples = made && status.samples ? `${status.samples} ${status.samples === 1 ? 'sample' : 'samples'} per point` : '';
  const method = made && status.method ? `method ${status.method}` : '';
  const facts = [size, samples, method].filter(Boolean).join(', ');
  return `${what}${sky}${facts ? `; ${facts}` : ''}.`;
}

// The word beside the dot.
export function stateWord(state) {
  if (state.name === 'live' && Number.isFinite(state.delayMs)) return `Live, ${milliseconds(state.delayMs)} behind`; // HLS
  if (state.name === 'connecting' && state.detail === 'preparing') return 'Preparing';
  return {
    connecting: 'Connecting',
    waiting: 'Waiting',
    live: 'Live',
    paused: 'Paused',
    ended: { better: 'Refining', done: 'Converged' }[state.still] ?? (state.single ? 'Still sky' : 'Ended'),
    failed: 'Bad frame',
    stalled: 'Stalled',
    reconnecting: 'Reconnecting',
    refused: 'Refused',
  }[state.name];
}

// The sentence for a state; `seen`: an image is on screen. The countdown is separate, so that a screen reader does not read it
// every second.
export function stateSentence(state, seen) {
  const stays = seen ? ' The last image stays on screen.' : '';
  const still = { better: 'its image is being refined', done: 'its image has converged' }[state.still];
  const because = state.detail ? `: ${withoutFolders(state.detail)}` : '';
  switch (state.name) {
    case 'connecting':
      if (state.detail === 'stream') return 'Loading the stream.';
      if (state.detail === 'preparing') return `Connected. The server is preparing the first image${state.seconds ? `, for ${state.seconds} s so far` : ''}.`;
      return state.detail === 'picture' ? 'Connected. Waiting for the first image.' : 'Connecting to the server.';
    case 'waiting':
      return state.detail ? `Waiting for a sky${because}.` : 'Waiting for a sky. The server is ready but has received no frame yet.';
    case 'live':
      if (!seen) return 'Waiting for the first image.';
      if (still) return `Live. The sky stands still, and ${still}.`;
      return state.still === 'idle' ? 'Live. No new image for a while.' : 'Live.';
    case 'paused':
      if (state.detail === 'hidden') return 'Paused while this page is hidden.';
      if (state.detail === 'press') return 'The browser does not start the stream by itself: press the image.';
      if (!seen && state.made) return 'The sky is paused. Waiting for its image.';
      return seen && still ? `The sky is paused, and ${still}.` : `The sky is paused.${stays}`;
    case 'ended':
      if (state.detail === 'publishing') return `Publishing has ended.${stays}`;
      if (seen && still) return `The sky stands still, and ${still}.`;
      if (seen) return state.single ? 'The sky stands still: it is a single image.' : 'The sky sequence has ended. The last image stays on screen.';
      return state.made
        ? 'The sky stands still. Waiting for its image.'
        : 'The sky sequence ended before an image was made.';
    case 'failed':
      return `A sky frame could not be used${because}.${stays}`;
    case 'stalled':
      if (state.late) return `The server has been computing one image for ${state.seconds} s, longer than its limit.${stays}`;
      if (state.published) return `Nothing new has been published for ${state.seconds} s.${stays}`;
      if (state.slow) return `The image has stood still for ${state.seconds} s: the stream arrives too slowly.`;
      return state.silent
        ? `Nothing received from the server for ${state.seconds} s.${stays}`
        : `The server answers, but has sent no image for ${state.seconds} s.${stays}`;
    case 'reconnecting':
      return `${state.detail || 'The connection broke.'}${stays} Retrying`;
    case 'refused':
      return `${state.detail}`;
    default:
      return '';
  }
}

// The sun's position: "14:35 solar time, sun 32° high in the south-west". Solar noon is when the sun is highest, which differs
// from local clock time; local: the time is that.
export function sunSentence(light, local = false) {
  const kind = local ? 'local time' : 'solar time';
  if (!light) return '';
  const time = light.time ? `${light.time} ${kind}, ` : '';
  if (!light.sun) return light.time ? `${light.time} ${kind}` : '';
  const names = ['north', 'north-east', 'east', 'south-east', 'south', 'south-west', 'west', 'north-west'];
  const where = names[Math.round((((light.sun.azimuth % 360) + 360) % 360) / 45) % 8];
  const up = Math.round(light.sun.elevation);
  return up >= 0 ? `${time}sun ${up}° high in the ${where}` : `${time}sun ${-up}° below the horizon in the ${where}`;
}

// What images between two skies do: " Between skies the sun moves, the rest fades; images are 5.0 s behind." "" without any.
export function betweenSentence(source) {
  if (!source?.between) return '';
  const behind = source.delay_s > 0 ? `; images are ${source.delay_s.toFixed(1)} s behind` : '';
  return ` Between skies ${source.between}${behind}.`;
}

// The time that a computation has left by its pace so far: take(share, now) with shares of 0 to 1 and milliseconds; seconds, which
// never rise: a pace that falls leaves them until the work catches up. null while the pace is unknown. A share below the last one,
// or none, is another computation.
export class Pace {
  take(share, now) {
    if (typeof share !== 'number') this.first = null;
    else if (!this.first || share < this.last) {
      this.first = { share, now };
      this.left = Infinity;
    }
    this.last = share;
    const done = this.first ? share - this.first.share : 0;
    if (!(done > 0.05 && now > this.first.now)) return null;
    this.left = Math.min(this.left, ((1 - share) / done) * ((now - this.first.now) / 1000));
    return this.left;
  }
}

// Which light the image contains, its estimated noise, the progress of the light-transport cache, the passes of a still sky, and
// the light it leaves out. left: seconds until the cache is complete; null if unknown.
export function lightSentence(light, left = null) {
  if (!light?.paths) return '';
  const off = light.error > 0 ? ` Noise about ${percent(Math.sqrt(light.error))}.`
    : light.error_at_most > 0 ? ` Noise at most ${percent(Math.sqrt(light.error_at_most))}.` : '';
  const share = typeof light.computed === 'number' ? ` Light-transport cache: ${Math.floor(100 * light.computed)} % computed${left === null ? '' : `, about ${Math.max(1, Math.round(left))} s left`}.` : '';
  const still = light.passes > 0
    ? ` Still sky: ${light.passes} ${light.passes === 1 ? 'pass' : 'passes'}, ${light.converged ? 'converged' : 'refining'}.`
    : '';
  return `Light: ${light.paths}.${off}${share}${still}${light.left_out ? ` Left out: ${light.left_out}.` : ''}`;
}

// Where live images are published: "Publishing to rtmp://media.example: live, 3.2 Mbit/s, 12 frames dropped."
export function publishSentence({ to, state, detail, mbit, dropped }) {
  const where = to.replace(/^(hls|record):.*\/(?=.)/, '$1:');
  const word = { waiting: 'waiting', connecting: 'connecting', live: 'live', retrying: 'failed' }[state] ?? state;
  const why = detail ? ` (${withoutFolders(detail)}${state === 'retrying' ? '; trying again' : ''})` : '';
  const rate = state === 'live' ? `, ${bitsPerSecond((mbit * 1e6) / 8)}` : '';
  return `Publishing to ${where}: ${word}${why}${rate}${dropped > 0 ? `, ${dropped} ${dropped === 1 ? 'frame' : 'frames'} dropped` : ''}.`;
}

const percent = (x) => `${(100 * x).toFixed(x < 0.0995 ? 1 : 0)} %`;

export function milliseconds(ms) {
  if (!Number.isFinite(ms)) return '–';
  if (ms >= 999.5) return `${(ms / 1000).toFixed(1)} s`;
  return `${ms < 9.95 ? ms.toFixed(1) : Math.round(ms)} ms`;
}

// The display name of an image coding.
export const codingName = (format) => ({ jpeg: 'JPEG', h264: 'H.264' })[format] ?? '';

// With the reason where it is not the one that costs least: "JPEG, since the server sent no H.264 image; trying again soon".
export function codingSentence(format, noVideo, again) {
  const why = format === 'jpeg' && noVideo && noVideo !== 'JPEG requested' ? `, since ${noVideo}${again ? '; trying again soon' : ''}` : '';
  return `${codingName(format)}${why}`;
}

export function bitsPerSecond(bytes) {
  const bits = bytes * 8;
  if (!(bits > 0)) return '–';
  return bits >= 1e6 ? `${(bits / 1e6).toFixed(bits < 1e7 ? 1 : 0)} Mbit/s` : `${Math.round(bits / 1e3)} kbit/s`;
}
