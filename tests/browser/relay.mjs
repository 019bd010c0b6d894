// A connection slower and longer than loopback: bytes to the page pass a bottleneck of so many per second, and both
// directions have a delay. The queue before the bottleneck is bounded, as in a router with a small queue: the rest
// waits at the server, by TCP. As a program: relay.mjs TARGET_PORT BYTES_PER_SECOND DELAY_MS.
import { connect, createServer } from 'node:net';
import { pathToFileURL } from 'node:url';

const QUEUE_BYTES = 32768;
const PIECE_BYTES = 1460;

// One direction of a connection. All share `line`: {bytesPerSecond, delayMs, frozen: a promise or null}.
function pump(from, to, line, limited) {
  let free = 0; // when the bottleneck is free again
  let waiting = 0; // bytes queued before it
  let last = Promise.resolve();
  from.on('data', (data) => {
    for (let at = 0; at < data.length; at += PIECE_BYTES) {
      const piece = data.subarray(at, at + PIECE_BYTES);
      const now = performance.now();
      if (limited) free = Math.max(free, now) + (1000 * piece.length) / line.bytesPerSecond;
      const through = limited ? free - now : 0;
      waiting += piece.length;
      const arrived = new Promise((resolve) => {
        setTimeout(() => {
          waiting -= piece.length;
          if (waiting < QUEUE_BYTES / 2) from.resume();
          setTimeout(resolve, line.delayMs);
        }, through);
      });
      // In order, whatever the timers do.
      last = last.then(() => arrived).then(() => line.frozen).then(() => { if (!to.destroyed) to.write(piece); });
    }
    if (waiting > QUEUE_BYTES) from.pause();
  });
  from.on('end', () => { last = last.then(() => to.end()); });
  from.on('error', () => to.destroy());
  from.on('close', () => { last = last.then(() => to.destroy()); });
}

// {port, set({bytesPerSecond, delayMs}), freeze(), thaw(), cut(), stop()}
export async function startRelay(target, { bytesPerSecond = 1e9, delayMs = 0 } = {}) {
  const line = { bytesPerSecond, delayMs, frozen: null };
  const sockets = new Set();
  const server = createServer((near) => {
    const far = connect(target, '127.0.0.1');
    for (const socket of [near, far]) {
      socket.setNoDelay(true);
      sockets.add(socket);
      socket.on('close', () => sockets.delete(socket));
    }
    pump(near, far, line, false);
    pump(far, near, line, true);
  });
  await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
  let thaw = () => {};
  return {
    port: server.address().port,
    url: `http://127.0.0.1:${server.address().port}/`,
    set: (change) => Object.assign(line, change),
    freeze: () => { line.frozen = new Promise((resolve) => { thaw = resolve; }); },
    thaw: () => {
      line.frozen = null;
      thaw();
    },
    cut: () => sockets.forEach((socket) => socket.destroy()),
    async stop() {
      thaw();
      sockets.forEach((socket) => socket.destroy());
      await new Promise((resolve) => { server.close(resolve); });
    },
  };
}

if (import.meta.url === pathToFileURL(process.argv[1] ?? '').href) {
  const [target, bytesPerSecond, delayMs] = process.argv.slice(2).map(Number);
  console.log(`listening on ${(await startRelay(target, { bytesPerSecond, delayMs })).url}`);
}
