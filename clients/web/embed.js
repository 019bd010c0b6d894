// The image alone, for frames of other pages and OBS's browser source: /embed. Takes `#token=...` and `?rate=`, `?width=`,
// `?coding=` as the page does. Until the first image, a sentence says what it waits for; after that the last image stays.

import { wishedPictures, wishedRole } from './role.js';
import { Screen } from './screen.js';
import { stateSentence } from './sentences.js';
import { startPlayer, watchPage } from './start.js';

const relight = { state: { name: 'connecting' }, frames: 0 };
window.relight = relight;

const screen = new Screen(document.getElementById('picture'), ({ header }, nowMs) => {
  send({ op: 'displayed', sequence: header.sequence, nowMs });
  relight.frames++;
  document.body.classList.add('seen');
});

function take(event) {
  if (event.op === 'picture') screen.show(event);
  if (event.op !== 'state') return;
  relight.state = event.state;
  document.getElementById('why').textContent = event.state.token
    ? 'The server requires a token: add #token=… to the address of this page.'
    : stateSentence(event.state, relight.frames > 0);
}

let send = () => {};
send = await startPlayer({ ...wishedRole(location), ...wishedPictures(location), role: 'viewer' }, take);
watchPage(send);
