// The panels: each folds at its heading, and the browser remembers its state.

import { make, recall, remember } from './dom.js';

const KEY = 'relight.folded';

function remembered() {
  try {
    return JSON.parse(recall(KEY)) ?? {};
  } catch {
    return {}; // not ours
  }
}

// Shows `<section id=ID>` with a heading and returns the element for its content, which receives the section's previous
// children. The <details> is panel.parentElement; open: the state for a first visitor.
export function makePanel(id, title, { open = true } = {}) {
  const section = document.getElementById(id);
  const body = make('div', { className: 'panel-body' }, ...section.childNodes);
  const heading = make('h2', { id: `${id}-title`, text: title });
  const details = make('details', { open: remembered()[id] ?? open }, make('summary', {}, heading), body);
  details.addEventListener('toggle', () => remember(KEY, JSON.stringify({ ...remembered(), [id]: details.open })));
  section.append(details);
  section.setAttribute('aria-labelledby', heading.id);
  section.hidden = false;
  return body;
}

// Whether an element in a panel is visible: in a folded panel it still has its size.
export const isSeen = (element) => element.clientWidth > 0 && document.visibilityState === 'visible' &&
  element.closest('.panel')?.querySelector('details')?.open === true;
