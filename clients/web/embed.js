// The image alone, for frames of other pages and OBS's browser source: /embed. Takes `#token=...` and `?rate=`, `?width=`,
// `?coding=`, or `?from=hls`, as the page does. Until the first image, a sentence says what it waits for; after that the last image stays.

import { wishedHls, wishedPictures, wishedRole } from './role.js';
import { Screen } from './screen.js';
import { stateSentence } from './sentences.js';
import { startPlayer, watchPage } from './start.js';

const relight = { state: { name: 'connecting' }, frames: 0 };
window.relight = relight;

const canvas = document.getElementById('picture');
const seen = () => document.body.classList.add('seen');

function show(state) {
  relight.state = state;
  document.getElementById('why').textContent = state.token
    ? 'The server requires a token: add #token=… to the address of this page.'
    : stateSentence(state, relight.frames > 0);
}

async function connect() {
  let say = () => {};
  const screen = new Screen(canvas, ({ header }, nowMs) => {
    say({ op: 'displayed', sequence: header.sequence, nowMs });
    relight.frames++;
    seen();
  });
  const take = (event) => {
    if (event.op === 'picture') screen.show(event);
    if (event.op === 'state') show(event.state);
  };
  say = await startPlayer({ ...wishedRole(location), ...wishedPictures(location), role: 'viewer' }, take);
  return say;
}

const send = wishedHls(location)
  ? (await import('./hls.js')).watchHls(canvas, { relight, show, drawn: seen })
  : await connect();
watchPage(send);
