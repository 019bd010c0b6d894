// Dark or light theme: the system's, until the user chooses.

const KEY = 'relight.theme';
const system = () => (matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark');

function chosen() {
  try {
    const theme = localStorage.getItem(KEY);
    return theme === 'dark' || theme === 'light' ? theme : null;
  } catch {
    return null;
  }
}

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
  try {
    if (now === system()) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, now);
  } catch {
    // lasts until the page closes
  }
  return now;
}
