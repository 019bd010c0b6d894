// What the page says, in words. Pure functions of the state, so that each sentence can be tested.

// Words begin with a capital; the name of a file stays as it is.
const capital = (text) => (/\s/.test(text) ? text[0].toUpperCase() + text.slice(1) : text);

// Of a path, what a person would call it: where a server keeps its files is nobody's business.
const plain = (text) => text?.replace(/\/+$/, '').replace(/^.*\//, '');

// Likewise for the paths in a reason, as "folder/a.exr: byte 3: torn": what stands before the first colon, which may
// have blanks, and every other one that begins with a slash or a dot.
export const withoutFolders = (text) => (text || '')
  .replace(/^(watch:)?[^:'"]*\/(?=[^/:]+: )/, '$1')
  .replace(/(^|[\s'":=(])\.{0,2}\/(?!\/)(?:[^\s:'"/]+\/)*/g, '$1');

// What is seen: "The built-in scene under a computed sky; 640 × 360, 64 samples per point, method mis." Before a picture was
// made nobody knows how.
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

// The short word beside the dot.
export function stateWord(state) {
  return {
    connecting: 'Connecting',
    waiting: 'Waiting',
    live: 'Live',
    paused: 'Paused',
    ended: { better: 'Getting better', done: 'Done' }[state.still] ?? 'Ended',
    failed: 'Bad frame',
    stalled: 'Stalled',
    reconnecting: 'Reconnecting',
    refused: 'Refused',
  }[state.name];
}

// The sentence for a state; `seen` is whether a picture is on the screen already. Without the countdown, which is
// shown beside it, so that a screen reader is not told every second.
export function stateSentence(state, seen) {
  const stays = seen ? ' The last picture stays.' : '';
  const still = { better: 'its picture is getting better', done: 'its picture is done' }[state.still];
  const because = state.detail ? `: ${withoutFolders(state.detail)}` : '';
  switch (state.name) {
    case 'connecting':
      return state.detail === 'picture' ? 'Connected. The first picture is on its way.' : 'Connecting to the server.';
    case 'waiting':
      return state.detail ? `Waiting for a sky${because}.` : 'Waiting for a sky. The server is ready and has had no frame yet.';
    case 'live':
      if (!seen) return 'The first picture is on its way.';
      if (still) return `Live. The sky stands still, and ${still}.`;
      return state.still === 'idle' ? 'Live. No new sky has come for a while.' : 'Live.';
    case 'paused':
      if (state.detail === 'hidden') return 'Paused while this page is hidden.';
      if (!seen && state.made) return 'The sky is paused. Its picture is on its way.';
      return seen && still ? `The sky is paused, and ${still}.` : `The sky is paused.${stays}`;
    case 'ended':
      if (seen) return still ? `The sky stands still, and ${still}.` : 'The sky sequence has ended. The last picture stays.';
      return state.made
        ? 'The sky stands still. Its picture is on its way.'
        : 'The sky sequence has ended before a picture was made.';
    case 'failed':
      return `A sky frame could not be used${because}.${stays}`;
    case 'stalled':
      return state.silent
        ? `Nothing has come from the server for ${state.seconds} s.${stays}`
        : `The server answers, but no picture has come for ${state.seconds} s.${stays}`;
    case 'reconnecting':
      return `${state.detail || 'The connection broke.'}${stays} Trying again`;
    case 'refused':
      return `${state.detail}`;
    default:
      return '';
  }
}

// Where the sun stands: "14:35 solar time, sun 32° high in the south-west". A sky's clock has its noon when the sun is
// highest, which is not what the clocks of its place say.
export function sunSentence(light) {
  if (!light) return '';
  const time = light.time ? `${light.time} solar time, ` : '';
  if (!light.sun) return light.time ? `${light.time} solar time` : '';
  const names = ['north', 'north-east', 'east', 'south-east', 'south', 'south-west', 'west', 'north-west'];
  const where = names[Math.round((((light.sun.azimuth % 360) + 360) % 360) / 45) % 8];
  const up = Math.round(light.sun.elevation);
  return up >= 0 ? `${time}sun ${up}° high in the ${where}` : `${time}sun ${-up}° below the horizon in the ${where}`;
}

// Which light the picture holds, how far it is from the truth, where the server says so, how much of what will make it
// better and quicker is computed, what has been done for a sky that stands still, and what is left out of it.
export function lightSentence(light) {
  if (!light?.paths) return '';
  const off = light.error > 0 ? ` Noise about ${percent(Math.sqrt(light.error))}.` : '';
  const share = typeof light.computed === 'number' ? ` Light transport: ${Math.floor(100 * light.computed)} % computed.` : '';
  const still = light.passes > 0
    ? ` Standing still: ${light.passes} ${light.passes === 1 ? 'pass' : 'passes'}, ${light.converged ? 'done' : 'getting better'}.`
    : '';
  return `Light: ${light.paths}.${off}${share}${still}${light.left_out ? ` Left out: ${light.left_out}.` : ''}`;
}

const percent = (x) => `${(100 * x).toFixed(x < 0.0995 ? 1 : 0)} %`;

export function milliseconds(ms) {
  if (!Number.isFinite(ms)) return '–';
  if (ms >= 999.5) return `${(ms / 1000).toFixed(1)} s`;
  return `${ms < 9.95 ? ms.toFixed(1) : Math.round(ms)} ms`;
}

// How the pictures come, as people call it.
export const codingName = (format) => ({ jpeg: 'JPEG', h264: 'H.264' })[format] ?? '';

export function bitsPerSecond(bytes) {
  const bits = bytes * 8;
  if (!(bits > 0)) return '–';
  return bits >= 1e6 ? `${(bits / 1e6).toFixed(bits < 1e7 ? 1 : 0)} Mbit/s` : `${Math.round(bits / 1e3)} kbit/s`;
}
