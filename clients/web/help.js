// The help overlay: what the page shows, and its keys.
import { make } from './dom.js';
import { keyName } from './keys.js';

const WHAT = 'The server relights one scene for every frame of a moving sky: direct light, and indirect light and caustics if they '
  + 'are on. Drag across the image to rotate the sky; with Alt, or with two fingers, to move the camera around what it looks at; '
  + 'Alt and the wheel, or pinching, change its distance. Press a panel\u2019s heading to fold it.';

const STREAM = 'This is a published stream of a scene relit by a moving sky, some seconds behind live. The server\u2019s own page has '
  + 'the controls.';

export function showHelp(dialog, keys, isStream) {
  if (dialog.open) {
    dialog.close();
    return;
  }
  const close = make('button', { type: 'button', autofocus: true, text: 'Close' });
  close.onclick = () => dialog.close();
  const names = (row) => row.keys.flatMap((key, i) => [i ? ' ' : '', make('kbd', { text: keyName(key) })]);
  dialog.replaceChildren( // the heading first, so that focus does not scroll the keys away
    make('div', { className: 'dialog-top' }, make('h2', { id: 'help-title', text: 'Help and keys' }), close),
    make('p', { text: isStream ? STREAM : WHAT }),
    make('table', {}, make('tbody', {}, ...keys.rows.map((row) =>
      make('tr', {}, make('th', { scope: 'row' }, ...names(row)), make('td', { text: row.label }))))));
  dialog.showModal();
}
