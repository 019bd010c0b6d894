// Dark or light: as the system has it until a person says otherwise, and then as that person said.

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

// Gives what it is now.
export function switchTheme() {
  const now = theme() === 'light' ? 'dark' : 'light';
  document.documentElement.dataset.theme = now;
  try {
    if (now === system()) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, now);
  } catch {
    // it lasts as long as the page
  }
  return now;
}
