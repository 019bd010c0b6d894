// clients/js/relight.js: its addresses and errors, in Node.js against relightd where there is a WebSocket, and in Chromium.
import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { readFileSync, mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { promisify } from 'node:util';
import * as library from '../../clients/js/relight.js';
import { openBrowser, startServer, whatIsMissing } from './lib.mjs';

const { Relight, RelightError, address } = library;
const folder = mkdtempSync(join(tmpdir(), 'relight-client-'));
let server;
before(async () => {
  server = await startServer(process.env.RELIGHT_RELIGHTD, ['--port', '0', '--size', '96x54', '--samples', '4', '--source',
    'sky:size=64x32', '--paths', 'direct', '--method', 'mis']);
});
after(async () => {
  await server?.stop();
  rmSync(folder, { recursive: true });
});

test('addresses', () => {
  assert.deepEqual(address('http://host:8080/#role=viewer&token=a%20b'), { url: 'ws://host:8080/ws', token: 'a b' });
  assert.deepEqual(address('https://host/sky/#token=a'), { url: 'wss://host/sky/ws', token: 'a' });
  assert.deepEqual(address('wss://host/other'), { url: 'wss://host/other', token: undefined });
  for (const wrong of ['host:8080', 'ftp://host', '']) assert.throws(() => address(wrong), /expected ws:/);
});

test('what is wrong is said', async () => {
  assert.throws(() => new Relight('ws://host', { role: 'producer' }), /role producer: expected/);
  assert.throws(() => new Relight('ws://host', { coding: 'png' }), /coding png: expected/);
  assert.throws(() => new Relight('ws://host', { coding: 'exr_half', decode: true }), /cannot be decoded/);
  if (!globalThis.WebSocket) assert.throws(() => new Relight('ws://host'), /there is no WebSocket/);
});

test('the types name what the module exports', () => {
  const types = readFileSync(new URL('../../clients/js/relight.d.ts', import.meta.url), 'utf8');
  const named = [...types.matchAll(/^export (?:const|class|function) (\w+)/gm)].map(([, name]) => name);
  assert.deepEqual(named.sort(), Object.keys(library).sort());
});

test('pictures and settings in Node.js', { skip: !globalThis.WebSocket && 'no WebSocket' }, async () => {
  const one = new Relight(server.url, { role: 'controller', coding: 'exr_float' });
  const settings = await one.control({ rotate_degrees: 45 });
  assert.equal(settings.rotate_degrees, 45);
  await assert.rejects(one.control({ tone: 'loud' }), (error) => error instanceof RelightError && error.code === 'bad_field');
  const answers = await Promise.all([1, 2, 3].map((stops) => one.control({ bias_stops: stops })));
  assert.equal(answers[2].bias_stops, 3);
  const { header, payload } = await one.picture();
  assert.equal(header.format, 'exr_float');
  assert.deepEqual([...payload.subarray(0, 4)], [0x76, 0x2f, 0x31, 0x01]);
  for await (const picture of one.pictures()) {
    assert.ok(picture.header.sequence > header.sequence);
    break;
  }
  const probed = await one.probe({ x: 48, y: 40, samples: 8 });
  assert.equal(probed.samples, 8);
  one.stop();
  const viewer = new Relight(server.url, { coding: 'h264', on: {} });
  await assert.rejects(viewer.control({ tone: 'linear' }), /only a controller/);
  assert.throws(() => viewer.picture(), /needs on.picture/);
  viewer.stop();
});

test('the example', { skip: !globalThis.WebSocket && 'no WebSocket' }, async () => {
  const example = new URL('../../clients/js/example.mjs', import.meta.url).pathname;
  const { stdout } = await promisify(execFile)(process.execPath, [...process.execArgv.filter((word) => word !== '--test'), example, server.url, join(folder, 'x.jpg')]);
  assert.match(stdout, /96x54, the sky turned by 90 degrees/);
  assert.equal(readFileSync(join(folder, 'x.jpg'))[0], 0xff);
});

test('decoded pictures in a page, from the library that relightd serves', async (t) => {
  const missing = await whatIsMissing();
  if (missing) {
    t.skip(missing);
    return;
  }
  const browser = await openBrowser();
  try {
    const page = await browser.newPage();
    await page.goto(server.url);
    const seen = await page.evaluate(async () => {
      const { Relight: Client } = await import('/js/relight.js');
      const relight = new Client(location.href, { role: 'controller' });
      const { header, bitmap } = await relight.picture();
      const { tone } = await relight.control({ tone: 'reinhard' });
      const size = [bitmap.displayWidth ?? bitmap.width, bitmap.displayHeight ?? bitmap.height];
      bitmap.close();
      relight.stop();
      return { tone, size, wanted: [header.width, header.height] };
    });
    assert.equal(seen.tone, 'reinhard');
    assert.deepEqual(seen.size, seen.wanted);
  } finally {
    await browser.close();
  }
});
