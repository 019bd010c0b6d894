// Creates and updates elements, and leaves unchanged ones alone, so that an open list stays open.

export function make(tag, { text, attributes = {}, ...properties } = {}, ...children) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  for (const [name, value] of Object.entries(properties)) {
    if (name === 'htmlFor' && tag === 'output') element.setAttribute('for', value);
    else element[name] = value;
  }
  element.append(...children);
  return element;
}

// options: pairs [value, text].
export function setOptions(select, options, value) {
  const key = JSON.stringify(options);
  if (select.dataset.options !== key) {
    select.dataset.options = key;
    select.replaceChildren(...options.map(([v, text]) => make('option', { value: v, text })));
  }
  if (select.value !== String(value)) select.value = value;
}

export function setValue(input, value) {
  if (Number(input.value) !== value) input.value = value;
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// An icon of 16 x 16 from the data of a path.
export function icon(data, className = '') {
  const [svg, path] = ['svg', 'path'].map((tag) => document.createElementNS('http://www.w3.org/2000/svg', tag));
  svg.setAttribute('viewBox', '0 0 16 16');
  svg.setAttribute('aria-hidden', 'true');
  path.setAttribute('class', className);
  path.setAttribute('d', data);
  svg.append(path);
  return svg;
}

// Binds a button and a key to one action, and names the key in the tooltip.
export function withKey(app, button, key, label, act) {
  const name = key.replace('+', ' + ').toUpperCase();
  button.title = `${label} (${name})`;
  button.setAttribute('aria-keyshortcuts', key.length === 1 ? name : key);
  button.onclick = act;
  app.key(key, label, act);
}

// The page's colours of the current theme, by name.
export function colours() {
  const style = getComputedStyle(document.documentElement);
  return (name) => style.getPropertyValue(name).trim();
}

// A canvas at its displayed size, to draw on: {context, unit: a CSS pixel, width, height}. height: by default as displayed.
export function begin(canvas, heightOf = (width, unit) => canvas.clientHeight * unit) {
  const unit = Math.max(1, window.devicePixelRatio);
  canvas.width = Math.max(64, Math.round(canvas.clientWidth * unit));
  canvas.height = Math.max(32, Math.round(heightOf(canvas.width, unit)));
  const context = canvas.getContext('2d');
  context.font = `${11 * unit}px system-ui, sans-serif`;
  context.lineWidth = unit;
  return { context, unit, width: canvas.width, height: canvas.height };
}

export function line(context, ...points) {
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

export function saveAs(blob, name) {
  const url = URL.createObjectURL(blob);
  make('a', { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

// What the browser remembers for this page; null: nothing, or no storage.
export function recall(key) {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

// null: forgets it. Without storage, what is set lasts until the page closes.
export function remember(key, value) {
  try {
    if (value === null) localStorage.removeItem(key);
    else localStorage.setItem(key, value);
  } catch {
    // as said
  }
}
