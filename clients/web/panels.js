// Panels beside the picture: each folds by its own heading, and stays as it was left, on this machine.

const KEY = 'relight.folded';

function remembered() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? {};
  } catch {
    return {}; // no storage here, or not ours: nothing is remembered
  }
}

function remember(id, open) {
  try {
    localStorage.setItem(KEY, JSON.stringify({ ...remembered(), [id]: open }));
  } catch {
    // as above
  }
}

// Shows the place `<section id=ID>` with a heading, and gives the element that its content goes into. What stood in it
// before becomes its content. The <details> is panel.parentElement; open: as a first visitor finds it.
export function makePanel(id, title, { open = true } = {}) {
  const section = document.getElementById(id);
  const details = document.createElement('details');
  const summary = document.createElement('summary');
  const heading = document.createElement('h2');
  const body = document.createElement('div');
  heading.textContent = title;
  heading.id = `${id}-title`;
  body.className = 'panel-body';
  body.append(...section.childNodes);
  summary.append(heading);
  details.append(summary, body);
  details.open = remembered()[id] ?? open;
  details.addEventListener('toggle', () => remember(id, details.open));
  section.append(details);
  section.setAttribute('aria-labelledby', heading.id);
  section.hidden = false;
  return body;
}

// Whether what stands in a panel can be seen: in a folded one it still has its size.
export const isSeen = (element) => element.clientWidth > 0 && document.visibilityState === 'visible' &&
  element.closest('.panel')?.querySelector('details')?.open === true;
