// Dark or light theme: the system's, until the user chooses.

import { recall, remember } from './dom.js';

const KEY = 'relight.theme';
const system = () => (matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark');

const chosen = () => ['dark', 'light'].find((name) => name === recall(KEY));

export const theme = () => document.documentElement.dataset.theme;

export function startTheme() {
  const follow = () => { document.documentElement.dataset.theme = chosen() ?? system(); };
  follow();
  matchMedia('(prefers-color-scheme: light)').addEventListener('change', follow);
}

// Returns the new theme.
export function switchTheme() {
  const now = theme() === 'light' ? 'dark' : 'light';
  document.documentElement.dataset.theme = now;
  remember(KEY, now === system() ? null : now);
  return now;
}
