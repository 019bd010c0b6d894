// Takes the screenshots of docs/internals/testing.md into a folder; docs/pictures/pages.sh calls it.
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { openBrowser, startServer, untilState, whatIsMissing } from './lib.mjs';

const [out, ...only] = process.argv.slice(2);
const missing = await whatIsMissing();
if (missing || !out) throw new Error(missing ?? 'which folder?');

const SKY = ['--source', 'sky:time=09:30,speed=0.2', '--size', '1280x720', '--fps', '4'];
const SMALL = [...SKY, '--size', '640x360']; // sharp enough for a phone, and quickly free of noise
const DESKTOP = { width: 1280, height: 800 };
const folder = mkdtempSync(join(tmpdir(), 'relight-pages-'));

const settled = (page, ms = 2500) => page.waitForTimeout(ms); // for noise to disappear and statistics to arrive
const drawn = (page) => page.waitForFunction(() => window.relight?.frames > 0 && window.relight.app.control);
const withSky = async (page) => { await drawn(page); await page.waitForFunction(() => window.relight.sky?.sky); };
const askFor = (page, wish) => page.evaluate((w) => window.relight.app.send({ op: 'control', request: 1, ...w }), wish);

// A grey sky, and an invalid file.
function skies() {
  const texel = Buffer.from([110, 120, 128, 129]);
  writeFileSync(join(folder, 'a.hdr'), Buffer.concat([
    Buffer.from('#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n'), ...Array(32).fill(texel)]));
  writeFileSync(join(folder, 'b.hdr'), 'torn');
  return join(folder, '*.hdr');
}

// name: {args, size, scheme, hash, act(page, server)}
const PAGES = {
  live: { act: withSky },
  light: { scheme: 'light', act: withSky },
  phone: { args: SMALL, size: { width: 390, height: 844 }, act: drawn },
  'phone-side': { args: SMALL, size: { width: 844, height: 390 }, act: drawn },
  help: { act: async (page) => { await drawn(page); await page.keyboard.press('?'); } },
  paused: {
    act: async (page) => {
      await drawn(page);
      await askFor(page, { paused: true, hour: 19.2 });
      await page.waitForFunction(() => window.relight.status.light.time === '19:12');
      await settled(page, 4000);
    },
  },
  camera: {
    act: async (page) => {
      await drawn(page);
      await page.selectOption('#set-camera', 'gallery');
      await page.waitForFunction(() => window.relight.status.camera === 'gallery');
    },
  },
  watching: { hash: '#role=viewer', act: drawn },
  waiting: { args: ['--source', 'push:'], act: (page) => untilState(page, 'waiting') },
  failed: { args: () => ['--source', skies(), '--size', '1280x720', '--rate', '0.5', '--fps', '4'], act: async (page) => { await drawn(page); await untilState(page, 'failed'); } },
  ended: { args: ['--source', 'sky:time=17:00', '--frames', '0-1', '--once', '--converge', '3e-3', '--size', '1280x720'], act: async (page) => { await untilState(page, 'ended'); await settled(page, 5000); await untilState(page, 'ended'); } },
  reconnecting: {
    act: async (page, server) => {
      await drawn(page);
      await settled(page);
      await server.stop();
      await untilState(page, 'reconnecting');
    },
  },
  probe: {
    act: async (page) => {
      await drawn(page);
      await askFor(page, { paused: true });
      const box = await page.locator('#picture').boundingBox();
      await page.mouse.click(box.x + 0.42 * box.width, box.y + 0.62 * box.height);
      await page.waitForSelector('#probe-shown:not([hidden])');
      await page.locator('#probe-title').evaluate((e) => e.scrollIntoView({ block: 'start' }));
    },
  },
  compare: {
    act: async (page) => {
      await drawn(page);
      await askFor(page, { paused: true, method: 'uniform', samples: 8 });
      await page.waitForFunction(() => window.relight.status.method === 'uniform');
      await page.keyboard.press('k');
      await askFor(page, { paused: true, method: 'mis', samples: 16 });
      await page.waitForFunction(() => window.relight.status.method === 'mis');
    },
  },
  insight: {
    act: async (page) => {
      await drawn(page);
      await settled(page, 12000);
      await askFor(page, { method: 'auto', samples: null });
      await settled(page, 12000);
      await page.locator('#insight-title').evaluate((e) => e.scrollIntoView({ block: 'start' }));
    },
  },
};

// The live image so many seconds after the start, without a cache on disk.
const FIRST_S = [1, 3, 10, 30];
async function takeFirst(browser) {
  const start = Date.now();
  const server = await startServer(process.env.RELIGHT_RELIGHTD, ['--port', '0', '--source', 'sky:time=10:00,speed=0.2', '--cache-dir', 'off']);
  const page = await browser.newPage({ viewport: DESKTOP });
  await page.goto(server.url);
  for (const second of FIRST_S) {
    await page.waitForTimeout(Math.max(0, 1000 * second - (Date.now() - start)));
    await page.locator('#picture').screenshot({ path: join(out, `first-${second}.jpg`), quality: 80 });
    console.log(`first-${second}.jpg`);
  }
  await page.close();
  await server.stop();
}

const browser = await openBrowser();
try {
  if (!only.length || only.includes('first')) await takeFirst(browser);
  for (const [name, { args = SKY, size = DESKTOP, scheme = 'dark', hash = '', act }] of Object.entries(PAGES)) {
    if (only.length && !only.includes(name)) continue;
    const server = await startServer(process.env.RELIGHT_RELIGHTD, ['--port', '0', ...(typeof args === 'function' ? args() : args)]);
    const page = await browser.newPage({ viewport: size, colorScheme: scheme });
    await page.goto(server.url + hash);
    await act(page, server);
    await settled(page, name === 'reconnecting' ? 100 : 2500);
    await page.screenshot({ path: join(out, `page-${name}.jpg`), quality: 88 });
    console.log(`page-${name}.jpg`);
    await page.close();
    await server.stop();
  }
} finally {
  await browser.close();
  rmSync(folder, { recursive: true });
}
