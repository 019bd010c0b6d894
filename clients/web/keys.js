// Keys that do something anywhere on the page, and the list of them that help shows. The matching is a pure function.

// What a key is called on paper.
const NAMES = { ' ': 'Space', ArrowLeft: '←', ArrowRight: '→', ArrowUp: '↑', ArrowDown: '↓' };
const partName = (part) => NAMES[part] ?? (part.length === 1 ? part.toUpperCase() : part);
export const keyName = (key) => (key.length === 1 ? partName(key) : key.split('+').map(partName).join(' + '));

// The key of an event as app.key names it: 'f', ' ', '?', 'ArrowLeft', 'Shift+ArrowLeft'; '' for what belongs to the
// browser. Of a sign such as '?' or '+' Shift is no part, since keyboards differ in how it is typed.
export function keyOf(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing) return '';
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const sign = key.length === 1 && !/[a-z ]/.test(key);
  return event.shiftKey && !sign ? `Shift+${key}` : key;
}

// Whether the element that has the focus needs this key itself.
export function isTaken(target, key) {
  const tag = target?.tagName;
  if (target?.isContentEditable || tag === 'TEXTAREA') return true;
  if (tag === 'INPUT' && !['range', 'checkbox', 'radio', 'button'].includes(target.type)) return key !== 'Escape';
  const bare = key.replace('Shift+', '');
  if (tag === 'SELECT') return bare.length === 1 || bare.startsWith('Arrow') || bare === 'Enter';
  if (tag === 'INPUT' && target.type !== 'button')
    return bare.startsWith('Arrow') || ['Home', 'End', 'PageUp', 'PageDown', ' '].includes(bare);
  if (tag === 'BUTTON' || tag === 'SUMMARY' || tag === 'A' || tag === 'INPUT') return bare === ' ' || bare === 'Enter';
  // What handles keys of its own, as a divider or a plot that arrows move, says which: data-keys="ArrowLeft ArrowRight".
  return (target?.dataset?.keys ?? '').split(' ').includes(bare);
}

export class Keys {
  constructor() {
    this.rows = [];
    this.byKey = new Map();
  }

  // One or more keys, as ['ArrowLeft', ','], for one action; each key has one meaning.
  add(keys, label, act) {
    const all = [keys].flat();
    for (const key of all) {
      if (this.byKey.has(key)) throw new Error(`the key '${key}' already means: ${this.byKey.get(key).label}`);
      this.byKey.set(key, { label, act });
    }
    this.rows.push({ keys: all, label });
  }

  // Whether the event was one of ours.
  press(event) {
    const key = keyOf(event);
    const found = this.byKey.get(key);
    if (!found || isTaken(event.target, key)) return false;
    event.preventDefault();
    found.act(event);
    return true;
  }
}
