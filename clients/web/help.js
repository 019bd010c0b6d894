// The overlay that says what the page is and which keys it has.
import { keyName } from './keys.js';

function make(tag, text) {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  return element;
}

const WHAT = 'The picture is one scene, lit anew for every frame of a moving sky: direct light, and what mirrors, glass and '
  + 'surfaces throw at each other where that is switched on. Drag across the picture to turn the sky; press a panel\u2019s heading to '
  + 'fold it.';

export function showHelp(dialog, keys) {
  if (dialog.open) {
    dialog.close();
    return;
  }
  const title = make('h2', 'What this is, and its keys');
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
  top.append(title, close); // first, so that the focus does not scroll the keys away
  dialog.replaceChildren(top, make('p', WHAT), table);
  dialog.showModal();
}
