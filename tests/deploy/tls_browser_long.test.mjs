// The page in Chromium through nginx and TLS, as for a remote user: images arrive over wss:, with H.264 if available,
// which requires a secure page.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { createInterface } from 'node:readline';
import { after, before, test } from 'node:test';
import { openBrowser, whatIsMissing } from '../browser/lib.mjs';

let missing = await whatIsMissing();
let browser;
let proxy;
let url;
if (!missing) {
  proxy = spawn('/usr/bin/python3', ['-B', new URL('proxy_run.py', import.meta.url).pathname, '--size', '320x180',
    '--samples', '4', '--source', 'sky:speed=10'], { stdio: ['pipe', 'pipe', 'inherit'] });
  [url] = await new Promise((resolve) => {
    createInterface(proxy.stdout).once('line', (line) => resolve([line]));
    proxy.on('exit', (code) => resolve([`skipped: no proxy, exit code ${code}`]));
  });
  if (url.startsWith('skipped: ')) missing = url.slice(9);
}
if (missing) {
  console.log(`skipped: ${missing}`);
  process.exit(0);
}
before(async () => {
  browser = await openBrowser();
});
after(async () => {
  await browser?.close();
  const ended = new Promise((resolve) => { proxy.on('exit', resolve); });
  proxy.stdin.end();
  await ended;
});

test('images arrive through TLS', async () => {
  const context = await browser.newContext({ ignoreHTTPSErrors: true });
  const page = await context.newPage();
  const faults = [];
  const sockets = [];
  page.on('pageerror', (error) => faults.push(String(error)));
  page.on('console', (message) => { if (message.type() === 'error') faults.push(message.text()); });
  page.on('websocket', (socket) => sockets.push(socket.url()));
  const answer = await page.goto(url);
  assert.equal(answer.headers()['strict-transport-security'], 'max-age=31536000');
  await page.waitForFunction(() => window.relight?.frames >= 3);
  assert.ok(await page.evaluate(() => window.isSecureContext));
  assert.deepEqual([...new Set(sockets)], [`${url.replace('https', 'wss')}ws`]);
  assert.deepEqual(faults, []);
});
