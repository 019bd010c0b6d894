// The page behind slow and long connections: images stay current, and it recovers by itself. Times are printed, not
// asserted. RELIGHT_PATTERN_SERVER names the server.
import assert from 'node:assert/strict';
import { connect, createServer } from 'node:net';
import { test } from 'node:test';
import { CREDIT } from '../../clients/js/protocol.js';
import { beginTests, startServer, until, untilFrames, untilSentence, untilState } from './lib.mjs';
import { startRelay } from './relay.mjs';

const chromium = await beginTests(['RELIGHT_PATTERN_SERVER']);
const PATTERN = chromium.RELIGHT_PATTERN_SERVER;
const BUILT_IN = process.env.RELIGHT_H264 === 'ON';
const CREDIT_H264 = 16; // PROTOCOL.md 5.11

// The page records time, numbers and age of each drawn image: both ends share one clock.
const note = () => {
  window.drawn = [];
  window.relight.app.on('picture', ({ header, nowMs, bytes }) => window.drawn.push({
    at: nowMs, sequence: header.sequence, frame: header.frame, format: header.format, flags: header.flags, bytes,
    age: nowMs - header.captureUs / 1000,
  }));
};

async function withRelay(args, line, query, body) {
  const server = await startServer(PATTERN, args);
  const relay = await startRelay(server.port, {}); // the page itself loads fast
  const page = await chromium.browser.newPage({ viewport: { width: 500, height: 400 } });
  const faults = [];
  page.on('pageerror', (error) => faults.push(String(error)));
  try {
    await page.goto(`${relay.url}${query}`);
    await untilFrames(page, 5);
    relay.set(line);
    await untilFrames(page, 4); // by now everything under way was sent over this connection
    await page.evaluate(note);
    await body(page, relay, server);
    assert.deepEqual(faults, []);
  } finally {
    await page.close();
    await relay.stop();
    await server.stop();
  }
}

// As nginx with `location /sky/ { proxy_pass http://relightd/; }`.
async function startBelow(target) {
  const server = createServer((near) => {
    near.once('data', (head) => {
      const far = connect(target, '127.0.0.1');
      const text = head.toString('latin1').replace(/^([A-Z]+) (\/sky)?\//, (all, verb, below) => `${verb} ${below ? '/' : '/outside/'}`);
      far.write(Buffer.from(text.replace(/\r\nConnection: keep-alive/i, '\r\nConnection: close'), 'latin1'));
      near.pipe(far).pipe(near);
      far.on('error', () => near.destroy());
      near.on('error', () => far.destroy());
    });
  });
  await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
  return { url: `http://127.0.0.1:${server.address().port}/sky/`, stop: () => server.close() };
}

test('the page lives below a path of a proxy', async () => {
  const server = await startServer(PATTERN, []);
  const proxy = await startBelow(server.port);
  const page = await chromium.browser.newPage();
  try {
    await page.goto(proxy.url);
    await untilFrames(page, 3);
    await page.goto(`${proxy.url}embed`);
    await page.waitForFunction(() => document.querySelector('canvas, img, video')?.width > 0);
  } finally {
    await page.close();
    proxy.stop();
    await server.stop();
  }
});

const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

// Of so many images: {frameMs between two, ageMs: medians; bytes of one}
async function watch(page, count) {
  await page.waitForFunction((n) => window.drawn.length >= n, count);
  const drawn = await page.evaluate(() => window.drawn.splice(0));
  const fresh = drawn.filter(({ flags }) => !(flags & 2));
  const gaps = drawn.slice(1).map(({ at }, i) => at - drawn[i].at);
  drawn.slice(1).forEach(({ sequence, frame }, i) => {
    assert.ok(sequence > drawn[i].sequence && frame > drawn[i].frame, 'an older picture was drawn');
  });
  return {
    frameMs: median(gaps), ageMs: median(fresh.map(({ age }) => age)),
    bytes: median(drawn.map(({ bytes }) => bytes)), format: drawn.at(-1).format,
  };
}

const say = (name, { frameMs, ageMs, bytes, format }, pathMs) =>
  console.log(`${name}: ${format}, pictures of ${(bytes / 1000).toFixed(1)} kB, one each ${frameMs.toFixed(0)} ms, `
    + `${ageMs.toFixed(0)} ms old when drawn; two of these times and the path are ${(2 * frameMs + pathMs).toFixed(0)} ms`);

for (const [bytesPerSecond, delayMs] of [[2.5e5, 20], [1e5, 100]]) {
  test(`over ${bytesPerSecond / 1000} kB/s and ${delayMs} ms the server passes over the JPEG pictures that the line has no room for`, () =>
    withRelay(['--size', '320x180', '--rough', '--quality', '90'], { bytesPerSecond, delayMs }, '?coding=jpeg', async (page) => {
      const skipped = () => page.evaluate(() => window.relight.status.skipped);
      const before = await skipped();
      say('at first', await watch(page, 10), delayMs);
      say('later', await watch(page, 10), delayMs);
      await page.waitForFunction((n) => window.relight.status.skipped > n, before);
      await untilState(page, 'live');
    }));
}

test('over a long slow connection H.264 arrives in an unbroken chain of small pictures', async (t) => {
  if (!BUILT_IN) {
    t.skip('no H.264 here');
    return;
  }
  const got = {};
  for (const query of ['', '?coding=jpeg'])
    await withRelay(['--size', '320x180', '--rough', '--quality', '85', '--h264'], { bytesPerSecond: 1e5, delayMs: 100 }, query,
      async (page) => {
        got[query] = await watch(page, 12);
        say('over 100 kB/s and 100 ms', got[query], 100);
        if (!query && got[query].format === 'h264') assert.equal(await page.evaluate(() => window.relight.noVideo), null);
      });
  if (got[''].format !== 'h264') {
    t.skip('this browser decodes no H.264');
    return;
  }
  // By how much more come depends on the machine, which may encode and decode fewer than the line has room for.
  assert.ok(4 * got[''].bytes < got['?coding=jpeg'].bytes);
});

for (const query of ['', '?coding=jpeg']) {
  test(`a line that hangs for a while goes on at the newest picture${query ? ', in JPEG' : ''}`, () =>
    withRelay(['--h264'], { bytesPerSecond: 1e7, delayMs: 10 }, query, async (page, relay, server) => {
      await page.waitForFunction(() => window.drawn.length >= 2);
      relay.freeze();
      await untilSentence(page, /^Nothing received from the server for \d+ s/);
      const { last, from } = await page.evaluate(() => ({ last: window.drawn.length, from: window.drawn.at(-1).frame }));
      server.say('dump /dev/null');
      await until(() => /dumped frame \d+/.test(server.text()));
      const thawed = Number(server.text().match(/dumped frame (\d+)/)[1]);
      relay.thaw();
      // The next images are those that were under way, and then new ones: hundreds are never caught up with.
      await page.waitForFunction((n) => window.drawn.at(-1).frame > n, thawed);
      const old = await page.evaluate(([n, frame]) => window.drawn.slice(n).filter((d) => d.frame < frame).length, [last, thawed]);
      console.log(`${old} images older than the thaw, after frame ${from} of ${thawed}`);
      assert.ok(old <= (query ? CREDIT : CREDIT_H264));
      await untilState(page, 'live');
      say('afterwards', await watch(page, 5), 10);
    }));
}

test('a broken connection is resumed in the same coding', () =>
  withRelay(['--h264'], { delayMs: 10 }, '', async (page, relay) => {
    const { format } = await watch(page, 5);
    for (let i = 0; i < 2; i++) {
      relay.cut();
      await page.waitForFunction(() => window.relight.state.name !== 'live');
      const begun = Date.now();
      await untilState(page, 'live');
      console.log(`again after ${Date.now() - begun} ms`);
      await untilFrames(page, 5);
      assert.equal(await page.evaluate(() => window.relight.lastHeader.format), format);
    }
  }));
