// Starts the player in a worker if possible, else in the page.

import { PATH } from './js/protocol.js';

// wish: as role.js returns it; take(event): player.js's events. Returns the function that takes its commands.
export async function startPlayer(wish, take) {
  const start = {
    op: 'start',
    url: new URL(PATH, location.href.replace(/^http/, 'ws')).href,
    hidden: document.visibilityState === 'hidden',
    ...wish,
  };
  const inPage = async () => {
    const { Player } = await import('./js/player.js');
    const player = new Player(take);
    player.command(start);
    return (message) => player.command(message);
  };
  try {
    const worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
    return await new Promise((resolve) => {
      worker.onmessage = (event) => {
        resolve((message) => worker.postMessage(message));
        take(event.data);
      };
      worker.onerror = () => {
        worker.terminate();
        resolve(inPage());
      };
      worker.postMessage(start);
    });
  } catch {
    return inPage();
  }
}

// Tells the player when the page is hidden or seen again, and when the network is back.
export function watchPage(send) {
  const look = () => send({ op: 'hidden', hidden: document.visibilityState === 'hidden' });
  document.addEventListener('visibilitychange', look);
  window.addEventListener('pageshow', look);
  document.addEventListener('resume', look);
  window.addEventListener('online', () => send({ op: 'retry' }));
}
