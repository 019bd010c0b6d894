// The help overlay: what the page shows, and its keys.
import { keyName } from './keys.js';

function make(tag, text) {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  return element;
}

const WHAT = 'The server relights one scene for every frame of a moving sky: direct light, and indirect light and caustics if they '
  + 'are on. Drag across the image to rotate the sky; press a panel\u2019s heading to fold it.';

export function showHelp(dialog, keys) {
  if (dialog.open) {
    dialog.close();
    return;
  }
  const title = make('h2', 'Help and keys');
  title.id = 'help-title';
  const table = make('table');
  for (const row of keys.rows) {
    const line = table.insertRow();
    const names = make('th');
    names.scope = 'row';
    row.keys.forEach((key, i) => names.append(i ? ' ' : '', make('kbd', keyName(key))));
    line.append(names, make('td', row.label));
  }
  const close = make('button', 'Close');
  close.type = 'button';
  close.autofocus = true;
  close.onclick = () => dialog.close();
  const top = make('div');
  top.className = 'dialog-top';
  top.append(title, close); // first, so that focus does not scroll the keys away
  dialog.replaceChildren(top, make('p', WHAT), table);
  dialog.showModal();
}
