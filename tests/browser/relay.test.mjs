// The page behind slow and long connections: images stay current, and it recovers by itself. Times are printed, not
// asserted, except for bounds that only a growing queue would break. RELIGHT_PATTERN_SERVER names the server.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { beginTests, startServer, state, untilFrames, untilState } from './lib.mjs';
import { startRelay } from './relay.mjs';

const chromium = await beginTests(['RELIGHT_PATTERN_SERVER']);
const PATTERN = chromium.RELIGHT_PATTERN_SERVER;
const BUILT_IN = process.env.RELIGHT_H264 === 'ON';

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
    await page.waitForTimeout(1500); // until everything under way was sent over this connection
    await page.evaluate(note);
    await body(page, relay, server);
    assert.deepEqual(faults, []);
  } finally {
    await page.close();
    await relay.stop();
    await server.stop();
  }
}

const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];

// {count, frameMs between two images, ageMs: medians; bytes of one}
async function watch(page, ms) {
  await page.waitForTimeout(ms);
  const drawn = await page.evaluate(() => window.drawn.splice(0));
  const fresh = drawn.filter(({ flags }) => !(flags & 2));
  const gaps = drawn.slice(1).map(({ at }, i) => at - drawn[i].at);
  assert.ok(drawn.length >= 4, `${drawn.length} pictures in ${ms} ms`);
  drawn.slice(1).forEach(({ sequence, frame }, i) => {
    assert.ok(sequence > drawn[i].sequence && frame > drawn[i].frame, 'an older picture was drawn');
  });
  return {
    count: drawn.length, frameMs: median(gaps), ageMs: median(fresh.map(({ age }) => age)),
    bytes: median(drawn.map(({ bytes }) => bytes)), format: drawn.at(-1).format,
  };
}

const say = (name, { count, frameMs, ageMs, bytes, format }, pathMs) =>
  console.log(`${name}: ${format}, ${count} pictures of ${(bytes / 1000).toFixed(1)} kB, one each ${frameMs.toFixed(0)} ms, `
    + `${ageMs.toFixed(0)} ms old when drawn; two of these times and the path are ${(2 * frameMs + pathMs).toFixed(0)} ms`);

for (const [bytesPerSecond, delayMs] of [[2.5e5, 20], [1e5, 100]]) {
  test(`over ${bytesPerSecond / 1000} kB/s and ${delayMs} ms JPEG is never older than two pictures and the path`, () =>
    withRelay(['--size', '320x180', '--rough', '--quality', '90'], { bytesPerSecond, delayMs }, '?coding=jpeg', async (page) => {
      const first = await watch(page, 3500);
      const second = await watch(page, 3500);
      say('at first', first, delayMs);
      say('later', second, delayMs);
      // A growing queue would be seconds long by now; one more image, as on a busy machine, is not.
      for (const { frameMs, ageMs } of [first, second])
        assert.ok(ageMs < 3 * frameMs + delayMs + 200, `${ageMs} ms old, a picture each ${frameMs} ms`);
      assert.ok(await page.evaluate(() => window.relight.status.skipped) > 0);
      assert.equal(await state(page), 'live');
    }));
}

test('over a long slow connection H.264 arrives in an unbroken chain, and more often than JPEG', async (t) => {
  if (!BUILT_IN) {
    t.skip('no H.264 here');
    return;
  }
  const got = {};
  for (const query of ['', '?coding=jpeg'])
    await withRelay(['--size', '320x180', '--rough', '--quality', '85', '--h264'], { bytesPerSecond: 1e5, delayMs: 100 }, query,
      async (page) => {
        got[query] = await watch(page, 5000);
        say('over 100 kB/s and 100 ms', got[query], 100);
        if (!query && got[query].format === 'h264') assert.equal(await page.evaluate(() => window.relight.noVideo), null);
      });
  if (got[''].format !== 'h264') {
    t.skip('this browser decodes no H.264');
    return;
  }
  // By how much depends on the machine, which may encode and decode fewer than the line has room for.
  assert.ok(got[''].count > got['?coding=jpeg'].count);
  assert.ok(4 * got[''].bytes < got['?coding=jpeg'].bytes);
  assert.ok(got[''].ageMs < got['?coding=jpeg'].ageMs);
});

for (const query of ['', '?coding=jpeg']) {
  test(`a line that hangs for a while goes on at the newest picture${query ? ', in JPEG' : ''}`, () =>
    withRelay(['--h264'], { bytesPerSecond: 1e7, delayMs: 10 }, query, async (page, relay) => {
      relay.freeze();
      await untilState(page, 'stalled');
      assert.match(await page.textContent('#sentence'), /^Nothing received from the server for \d+ s/);
      relay.thaw();
      await untilState(page, 'live');
      await page.waitForTimeout(1000);
      await page.evaluate(() => { window.drawn.length = 0; });
      const later = await watch(page, 2000);
      say('after three silent seconds', later, 10);
      assert.ok(later.ageMs < 1000, `${later.ageMs}`);
    }));
}

test('a broken connection is resumed in the same coding', () =>
  withRelay(['--h264'], { delayMs: 10 }, '', async (page, relay) => {
    const { format } = await watch(page, 1000);
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
