// Page-wide keys, and their list for the help overlay. Matching is a pure function.

// Display names of keys.
const NAMES = { ' ': 'Space', ArrowLeft: '←', ArrowRight: '→', ArrowUp: '↑', ArrowDown: '↓' };
const partName = (part) => NAMES[part] ?? (part.length === 1 ? part.toUpperCase() : part);
export const keyName = (key) => (key.length === 1 ? partName(key) : key.split('+').map(partName).join(' + '));

// The key of an event as app.key names it: 'f', ' ', '?', 'ArrowLeft', 'Shift+ArrowLeft'; '' for the browser's own shortcuts.
// Signs such as '?' or '+' ignore Shift, since keyboards differ in how they are typed.
export function keyOf(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing) return '';
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const sign = key.length === 1 && !/[a-z ]/.test(key);
  return event.shiftKey && !sign ? `Shift+${key}` : key;
}

// Whether the focused element needs this key itself.
export function isTaken(target, key) {
  const tag = target?.tagName;
  if (target?.isContentEditable || tag === 'TEXTAREA') return true;
  if (tag === 'INPUT' && !['range', 'checkbox', 'radio', 'button'].includes(target.type)) return key !== 'Escape';
  const bare = key.replace('Shift+', '');
  if (tag === 'SELECT') return bare.length === 1 || bare.startsWith('Arrow') || bare === 'Enter';
  if (tag === 'INPUT' && target.type === 'range') // to which Space does nothing: it pauses, also after dragging the timeline
    return bare.startsWith('Arrow') || ['Home', 'End', 'PageUp', 'PageDown'].includes(bare);
  if (tag === 'INPUT' && target.type !== 'button')
    return bare.startsWith('Arrow') || ['Home', 'End', 'PageUp', 'PageDown', ' '].includes(bare);
  if (tag === 'BUTTON' || tag === 'SUMMARY' || tag === 'A' || tag === 'INPUT') return bare === ' ' || bare === 'Enter';
  // Elements with keys of their own, such as a divider, list them: data-keys="ArrowLeft ArrowRight".
  return (target?.dataset?.keys ?? '').split(' ').includes(bare);
}

export class Keys {
  constructor() {
    this.rows = [];
    this.byKey = new Map();
  }

  // One or more keys, such as ['ArrowLeft', ','], for one action; each key has one action.
  add(keys, label, act) {
    const all = [keys].flat();
    for (const key of all) {
      if (this.byKey.has(key)) throw new Error(`the key '${key}' already has the action: ${this.byKey.get(key).label}`);
      this.byKey.set(key, { label, act });
    }
    this.rows.push({ keys: all, label });
  }

  // Handles the event; true if it was one of our keys.
  press(event) {
    const key = keyOf(event);
    const found = this.byKey.get(key);
    if (!found || isTaken(event.target, key)) return false;
    event.preventDefault();
    found.act(event);
    return true;
  }
}
