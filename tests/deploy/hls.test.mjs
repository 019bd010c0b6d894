// The whole way, in Chromium: relightd publishes, to a folder or by RTMP, nginx serves page and stream with the files of deploy/, and
// the page goes on when relightd was killed and started again.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { createInterface } from 'node:readline';
import { describe, test } from 'node:test';
import { beginTests, readback, untilFrames, untilState } from '../browser/lib.mjs';

const { browser } = await beginTests([], () => (process.env.RELIGHT_H264 === 'ON' ? undefined : 'built without H.264'));

async function start(way) {
  const child = spawn('/usr/bin/python3', ['-B', new URL('hls_run.py', import.meta.url).pathname, way, '--size', '160x90', '--samples', '1',
    '--method', 'mis', '--paths', 'direct', '--converge', 'off', '--source', 'sky:size=64x32,time=12:00,speed=10'], { stdio: ['pipe', 'pipe', 'inherit'] });
  const ended = new Promise((resolve) => { child.on('exit', resolve); });
  const url = await new Promise((resolve, reject) => {
    createInterface(child.stdout).once('line', resolve);
    child.on('exit', (code) => reject(new Error(`hls_run.py ended with code ${code}`)));
  });
  return {
    url,
    kill: () => child.stdin.write('kill\n'),
    stop: async () => {
      child.stdin.end();
      await ended;
    },
  };
}

describe('published by relightd', { concurrency: 2 }, () => {
  for (const way of ['hls', 'rtmp']) {
    test(`${way}: the page shows it, and goes on after a restart`, async (t) => {
      const site = await start(way);
      if (site.url.startsWith('skipped: ')) {
        t.skip(site.url);
        return;
      }
      const context = await browser.newContext({ ignoreHTTPSErrors: true });
      try {
        const page = await context.newPage();
        const faults = [];
        const hosts = new Set();
        page.on('pageerror', (error) => faults.push(String(error)));
        page.on('console', (message) => { if (/policy|refused to/i.test(message.text())) faults.push(message.text()); });
        page.on('request', (request) => hosts.add(new URL(request.url()).host));
        page.on('websocket', (socket) => faults.push(socket.url()));
        await page.goto(site.url);
        assert.equal(new URL(page.url()).search, '?from=hls');
        await untilState(page, 'live');
        await untilFrames(page, 20);
        const { width, height, data } = await readback(page);
        assert.deepEqual([width, height], [160, 90]);
        assert.ok(data.some((value, i) => i % 4 < 3 && value > 100), 'a black picture');
        await page.waitForFunction(() => /^Live, \d+(\.\d)? (s|ms) behind$/.test(document.querySelector('#state-word').textContent));
        site.kill();
        const before = await page.evaluate(() => window.relight.player.newest);
        await page.waitForFunction((old) => { // a start is a leap in the numbers of segments
          const start = (name) => Number(name.match(/live-(\d+)/)[1]);
          return Math.abs(start(window.relight.player.newest) - start(old)) > 1000 && window.relight.state.name === 'live';
        }, before);
        await untilFrames(page, 10);
        assert.deepEqual(faults, []);
        assert.deepEqual([...hosts], [new URL(site.url).host]);
      } finally {
        await context.close();
        await site.stop();
      }
    });
  }
});
