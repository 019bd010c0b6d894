// Turns the sky of relightd and saves an image: node example.mjs [ws://HOST:PORT[/#token=...]] [FILE.jpg]
import { writeFile } from 'node:fs/promises';
import { Relight } from './relight.js';

const [, , address = 'ws://localhost:8080', file = 'picture.jpg'] = process.argv;
const relight = new Relight(address, {
  role: 'controller',
  coding: 'jpeg',
  WebSocket: globalThis.WebSocket ?? (await import('ws')).WebSocket, // before Node.js 22
});
try {
  const settings = await relight.control({ rotate_degrees: 90, tone: 'filmic' });
  const { header, payload } = await relight.picture();
  await writeFile(file, payload);
  console.log(`${file}: ${header.width}x${header.height}, the sky turned by ${settings.rotate_degrees} degrees`);
} catch (error) {
  console.error(error.message);
  process.exitCode = 1;
}
relight.stop();
