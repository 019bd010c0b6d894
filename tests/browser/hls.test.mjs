// The page with `?from=hls`: plays what ffmpeg publishes, from a server of plain files that can be told to fail, under the policy of
// deploy/nginx-hls.conf.
import assert from 'node:assert/strict';
import { spawn, spawnSync } from 'node:child_process';
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { extname, join } from 'node:path';
import { describe, test } from 'node:test';
import { parsePlaylist, typeOf } from '../../clients/web/hls_playlist.js';
import { beginTests, openPage, readback, state, until, untilFrames, untilSentence, untilState } from './lib.mjs';

const { browser } = await beginTests([], () =>
  (spawnSync('ffmpeg', ['-version']).error ? 'no ffmpeg' : undefined));
const root = new URL('../../', import.meta.url).pathname;
const policy = readFileSync(join(root, 'deploy/nginx-hls.conf'), 'utf8').match(/Content-Security-Policy "([^"]+)"/)[1];
const TYPES = {
  '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml', '.m3u8': 'application/vnd.apple.mpegurl',
  '.mp4': 'video/mp4', '.m4s': 'video/iso.segment', '.ts': 'video/mp2t',
};

// Serves the page and a folder. `site.answer(path)`, if set, returns {status} or {body} in place of a file's, {cut: true} to hang up.
async function withSite(act) {
  const folder = mkdtempSync(join(tmpdir(), 'relight-hls-'));
  mkdirSync(join(folder, 'hls'));
  const site = { folder: join(folder, 'hls'), asked: [], answer: () => null, headers: {}, publishers: [] };
  const server = createServer((request, response) => {
    const { pathname } = new URL(request.url, 'http://site');
    site.asked.push(pathname);
    const path = pathname.startsWith('/hls/') ? join(folder, pathname)
      : join(root, 'clients/web', { '/': 'index.html', '/embed': 'embed.html' }[pathname] ?? pathname);
    const special = site.answer(pathname);
    if (special?.cut) {
      request.socket.destroy();
      return;
    }
    const status = special?.status ?? (special?.body || existsSync(path) ? 200 : 404);
    response.writeHead(status, {
      'content-type': TYPES[extname(path)] ?? 'text/plain', 'content-security-policy': policy, 'cache-control': 'no-cache',
      ...site.headers,
    });
    response.end(special?.body ?? (status === 200 ? readFileSync(path) : 'no'));
  });
  await new Promise((resolve) => { server.listen(0, '127.0.0.1', resolve); });
  site.url = `http://127.0.0.1:${server.address().port}/?from=hls`;
  site.page = await openPage(browser, 'about:blank', { width: 500, height: 400 });
  site.page.violations = [];
  site.page.sockets = [];
  site.page.on('websocket', (socket) => site.page.sockets.push(socket.url()));
  site.page.on('console', (message) => {
    if (/content security policy|refused to/i.test(message.text())) site.page.violations.push(message.text());
  });
  try {
    await act(site, site.page);
    assert.deepEqual(site.page.violations, []);
    assert.deepEqual(site.page.sockets, []);
    assert.deepEqual(site.page.faults, []);
  } finally {
    await site.page.close();
    await Promise.all(site.publishers.map((publisher) => publisher.stop('SIGKILL')));
    server.closeAllConnections();
    server.close();
    rmSync(folder, { recursive: true, force: true });
  }
}

// Publishes two colours side by side, as `relightd --publish hls:DIR` does, in segments of half a second; waits for the playlist.
async function publish(site, { left = 'red', size = '160x90', options = ['-hls_segment_type', 'fmp4'], extension = 'm4s', name = 's' } = {}) {
  const [width, height] = size.split('x').map(Number);
  const half = (colour) => `color=${colour}:s=${width / 2}x${height}:r=10`;
  const child = spawn('ffmpeg', ['-hide_banner', '-loglevel', 'error', '-re', '-f', 'lavfi', '-i',
    `${half(left)}[a];${half('blue')}[b];[a][b]hstack`, '-c:v', 'libx264', '-preset', 'ultrafast', '-tune', 'zerolatency', '-pix_fmt',
    'yuv420p', '-g', '5', '-f', 'hls', '-hls_time', '0.5', '-hls_list_size', '8', ...options, '-hls_flags',
    'delete_segments+program_date_time+independent_segments+temp_file', '-hls_segment_filename', join(site.folder, `${name}%05d.${extension}`),
    join(site.folder, 'live.m3u8')], { stdio: ['pipe', 'inherit', 'inherit'] });
  const ended = new Promise((resolve) => { child.on('exit', resolve); });
  const publisher = {
    stop: async (signal) => { // SIGINT: ends the playlist
      child.kill('SIGCONT');
      child.kill(signal);
      await ended;
    },
    pause: () => child.kill('SIGSTOP'),
    go: () => child.kill('SIGCONT'),
  };
  site.publishers.push(publisher);
  return publisher;
}

// The playlist as published; null before.
const playlistOf = (site) => {
  const path = join(site.folder, 'live.m3u8');
  return existsSync(path) ? readFileSync(path, 'utf8') : null;
};

// As if it had been published so long ago.
const aged = (site, ms) => playlistOf(site)?.replace(/(DATE-TIME:)(\S+)/g, (_, tag, date) =>
  tag + new Date(Date.parse(date.replace(/(\d\d)$/, ':$1')) - ms).toISOString());

// Waits until so many more segments were published.
async function untilPublished(site, count) {
  const number = () => Number(playlistOf(site)?.match(/MEDIA-SEQUENCE:(\d+)/)[1] ?? 0);
  const from = number();
  await until(() => number() >= from + count);
}

// The colour at the left and at the right of the picture.
async function colours(page) {
  const { width, height, data } = await readback(page);
  const at = (x) => [...data.subarray(4 * (Math.floor(height / 2) * width + x)).subarray(0, 3)];
  return { width, height, left: at(Math.floor(width / 4)), right: at(Math.floor((3 * width) / 4)) };
}

// Most of their time they wait.
describe('the page from HLS', { concurrency: 4 }, () => {
  test('a published stream is shown, with its delay, and no connection to relightd', () => withSite(async (site, page) => {
    await publish(site);
    await page.goto(site.url);
    await untilState(page, 'live');
    await untilFrames(page, 20);
    const { width, height, left, right } = await colours(page);
    assert.deepEqual([width, height], [160, 90]);
    assert.ok(left[0] > 230 && left[2] < 30, `${left}`);
    assert.ok(right[2] > 230 && right[0] < 30, `${right}`);
    await page.waitForFunction(() => /^Live, \d+(\.\d)? (s|ms) behind$/.test(document.getElementById('state-word').textContent));
    assert.match(await page.textContent('#about'), /HLS, 160\s×\s90/);
    assert.equal(await page.isVisible('#panels'), false);
    assert.ok(await page.isVisible('#picture'));
    assert.deepEqual(site.asked.filter((path) => path.startsWith('/ws')), []);
  }));

  test('the delay counts from the playlist\u2019s dates, by the server\u2019s clock', () => withSite(async (site, page) => {
    const HOUR = 3600000;
    await publish(site);
    site.answer = (path) => (path.endsWith('.m3u8') && playlistOf(site) ? { body: aged(site, HOUR) } : null);
    await page.goto(site.url);
    await page.waitForFunction((hour) => window.relight.state.delayMs > hour && window.relight.state.delayMs < 1.5 * hour, HOUR);
    // and a server whose clock is an hour behind, as the playlist's
    const timer = setInterval(() => { site.headers = { date: new Date(Date.now() - HOUR).toUTCString() }; }, 100);
    await page.waitForFunction((hour) => window.relight.state.delayMs < hour / 2, HOUR).finally(() => clearInterval(timer));
  }));

  test('a missing stream is named, and shown as soon as it is there', () => withSite(async (site, page) => {
    await page.goto(site.url);
    await untilSentence(page, /^There is no stream at hls\/live\.m3u8 \(404\): nothing is being published there\. Retrying$/);
    assert.match(await page.textContent('#veil-sentence'), /no stream at/);
    await publish(site);
    await untilState(page, 'live');
  }));

  test('a stream that stands still says so, and goes on', () => withSite(async (site, page) => {
    const publisher = await publish(site);
    await page.goto(site.url);
    await untilState(page, 'live');
    publisher.pause();
    await untilSentence(page, /^Nothing new has been published for \d+ s\. The last image stays on screen\.$/);
    publisher.go();
    await untilState(page, 'live');
    await untilFrames(page, 10);
    // a page that is opened now knows since when: for an hour
    publisher.pause();
    site.answer = (path) => (path.endsWith('.m3u8') ? { body: aged(site, 3600000) } : null);
    await page.reload();
    await page.waitForFunction(() => window.relight?.frames > 0 && window.relight.state.name === 'stalled' && window.relight.state.seconds >= 3600);
  }));

  test('a stream that ends and begins anew, from zero and in another size', () => withSite(async (site, page) => {
    const publisher = await publish(site);
    await page.goto(site.url);
    await untilState(page, 'live');
    await untilFrames(page, 30); // so that the second begins with lower numbers
    await publisher.stop('SIGINT');
    await untilSentence(page, /^Publishing has ended\. The last image stays on screen\.$/);
    await page.evaluate(() => { // as long ago as it takes some publishers to begin again
      window.before = window.relight.player.engine;
      window.relight.player.movedMs -= 60000;
    });
    await publish(site, { left: 'lime', size: '192x108', name: 'other' });
    await untilState(page, 'live');
    await page.waitForFunction(() => document.querySelector('#picture').videoWidth === 192);
    await untilFrames(page, 5);
    const { left } = await colours(page);
    assert.ok(left[1] > 200 && left[0] < 30, `${left}`);
    assert.ok(await page.evaluate(() => window.relight.player.engine === window.before), 'it was noticed late, by a video that stood still');
  }));

  test('faults of the server are told apart', () => withSite(async (site, page) => {
    await publish(site);
    await page.goto(site.url);
    await untilState(page, 'live');
    const onPlaylist = (what) => (path) => (path.endsWith('.m3u8') ? what : null);
    for (const [answer, said] of [
      [onPlaylist({ body: '<!doctype html><p>Welcome' }), /^hls\/live\.m3u8 is no HLS playlist\./],
      [onPlaylist({ status: 503 }), /^The server answers 503 for hls\/live\.m3u8\./],
      [onPlaylist({ status: 403 }), /^The server does not allow hls\/live\.m3u8 \(403\)\./],
      [(path) => (path.endsWith('.m4s') ? { status: 404 } : null), /^The segment s\d+\.m4s of hls\/live\.m3u8 is missing \(404\)\./],
      [onPlaylist({ cut: true }), /^The server of hls\/live\.m3u8 does not answer\./],
    ]) {
      site.answer = answer;
      await untilSentence(page, said);
      assert.equal(await state(page), 'reconnecting');
      site.answer = () => null;
      await untilState(page, 'live');
    }
    site.answer = (path) => (path.endsWith('.m4s') ? { body: Buffer.from('no segment at all, but some text in place of one') } : null);
    await untilSentence(page, /^The segment s\d+\.m4s of hls\/live\.m3u8 is no fragmented MP4\./);
    const box = Buffer.concat([Buffer.from([0, 0, 0, 16]), Buffer.from('moof'), Buffer.from([0, 0, 0, 8]), Buffer.from('mfhd')]);
    site.answer = (path) => (path.endsWith('.m4s') ? { body: box } : null);
    await untilSentence(page, /^hls\/live\.m3u8 cannot be (decoded|played) by this browser/);
    site.answer = () => null;
    await untilState(page, 'live');
    await untilFrames(page, 5);
  }));

  test('without MediaSource the browser\u2019s own player is used, and without both a reason is given', () => withSite(async (site, page) => {
    await publish(site);
    await page.addInitScript(() => { delete window.MediaSource; });
    await page.goto(site.url);
    await untilState(page, 'live');
    await untilFrames(page, 20);
    const { left } = await colours(page);
    assert.ok(left[0] > 230 && left[2] < 30, `${left}`);
    await page.waitForFunction(() => /^Live, \d+(\.\d)? (s|ms) behind$/.test(document.getElementById('state-word').textContent));
    await page.addInitScript(() => { HTMLVideoElement.prototype.canPlayType = () => ''; });
    await page.reload();
    await untilSentence(page, /^hls\/live\.m3u8 needs a browser with MediaSource or HLS\./);
  }));

  test('what is not fragmented MP4 is refused where the browser plays no other', () => withSite(async (site, page) => {
    await publish(site, { options: ['-hls_segment_type', 'mpegts'], extension: 'ts' });
    await page.addInitScript(() => { HTMLVideoElement.prototype.canPlayType = () => ''; }); // as Firefox
    await page.goto(site.url);
    await untilSentence(page, /^hls\/live\.m3u8 is not fragmented MP4, and this browser plays no other HLS\./);
  }));

  test('a hidden page loads nothing, and shows the newest image when it is seen', () => withSite(async (site, page) => {
    await publish(site);
    await page.goto(site.url);
    await untilState(page, 'live');
    const hide = (hidden) => page.evaluate((h) => {
      Object.defineProperty(document, 'visibilityState', { value: h ? 'hidden' : 'visible', configurable: true });
      document.dispatchEvent(new Event('visibilitychange'));
    }, hidden);
    await hide(true);
    await untilState(page, 'paused');
    await untilPublished(site, 3); // by now what was under way is there
    const asked = site.asked.length;
    await untilPublished(site, 4);
    assert.equal(site.asked.length, asked);
    await hide(false);
    await untilState(page, 'live');
    await untilFrames(page, 5);
  }));

  test('/embed shows the same stream alone', () => withSite(async (site, page) => {
    await publish(site);
    await page.goto(site.url.replace('/?', '/embed?'));
    await untilFrames(page, 10);
    assert.equal(await page.locator('body').innerText(), '');
    const { left } = await colours(page);
    assert.ok(left[0] > 230 && left[2] < 30, `${left}`);
  }));
});

test('playlists are read as they are written', () => {
  const base = 'https://cdn.example/a/live.m3u8?x';
  const list = parsePlaylist('#EXTM3U\r\n#EXT-X-TARGETDURATION:2\r\n#EXT-X-MEDIA-SEQUENCE:7\n#EXT-X-MAP:URI="i.mp4"\n'
    + '#EXT-X-PROGRAM-DATE-TIME:2026-01-02T03:04:05.500+0100\n#EXTINF:1.5,name\na.m4s\n#EXTINF:2.0,\nb.m4s\n'
    + '#EXT-X-DISCONTINUITY\n#EXT-X-MAP:URI="/j.mp4"\n#EXTINF:1,\nhttps://other.example/c.m4s\n#EXT-X-ENDLIST\n', base);
  const date = Date.UTC(2026, 0, 2, 2, 4, 5, 500);
  assert.deepEqual({ ...list, segments: list.segments.map((s) => [s.sequence, s.url, s.map, s.seconds, s.date, s.broken]) }, {
    target: 2, ended: true, plain: true, map: 'https://cdn.example/j.mp4', segments: [
      [7, 'https://cdn.example/a/a.m4s', 'https://cdn.example/a/i.mp4', 1.5, date, false],
      [8, 'https://cdn.example/a/b.m4s', 'https://cdn.example/a/i.mp4', 2, date + 1500, false],
      [9, 'https://other.example/c.m4s', 'https://cdn.example/j.mp4', 1, date + 3500, true],
    ],
  });
  assert.equal(parsePlaylist('#EXTM3U\n#EXT-X-STREAM-INF:BANDWIDTH=1\nlow/a.m3u8\n', base).variant, 'https://cdn.example/a/low/a.m3u8');
  assert.equal(parsePlaylist('#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\na.ts\n', base).plain, false);
  for (const text of ['', 'hello', '#EXTM3U\n', '#EXTM3U\na.ts\n']) assert.throws(() => parsePlaylist(text, base), /is no HLS playlist/);
  const init = new Uint8Array([0, 0, 0, 0, 0x61, 0x76, 0x63, 0x43, 1, 0x42, 0xc0, 0x1e, 0xff]);
  assert.equal(typeOf(init), 'video/mp4; codecs="avc1.42c01e"');
  assert.equal(typeOf(init.subarray(0, 10)), null);
});
