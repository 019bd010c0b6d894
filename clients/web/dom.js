// Creates and updates elements, and leaves unchanged ones alone, so that an open list stays open.

export function make(tag, { text, ...properties } = {}, ...children) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
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
