// Age of an image when drawn, on one machine, at 30 frames per second: from the capture of its sky (when the source
// began to read the frame) to the end of drawing in Chromium. Not a test: prints a table, one line per coding and
// size. Target: a median of at most one frame time and 50 ms.
// usage: node latency-bench.mjs RELIGHTD [PATTERN_SERVER]      (build/bin/relightd, build/bin/pattern_server)
import { execFileSync } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { openBrowser, openPage, startServer, untilFrames } from './lib.mjs';

const [relightd, pattern] = process.argv.slice(2);
if (!relightd) {
  console.error('usage: node latency-bench.mjs RELIGHTD [PATTERN_SERVER]');
  process.exit(2);
}
const FPS = 30;
const ROUNDS = 3; // of each, alternating, so that other load affects all equally
const SECONDS = 6;

const at = (values, share) => [...values].sort((a, b) => a - b)[Math.min(values.length - 1, Math.floor(share * values.length))];

// Records each drawn image that is not a repetition: its times in ms.
const note = () => {
  window.drawn = [];
  window.relight.app.on('picture', ({ header, nowMs, heardMs, decodeMs, clock, bytes }) => {
    if (header.flags & 2 || header.flags & 32) return;
    const server = (header.queuedUs + header.decodedUs + header.shadedUs + header.encodedUs) / 1000;
    const published = (header.publishedUs - clock.offsetUs) / 1000;
    const captured = header.captureUs ? (header.captureUs - clock.offsetUs) / 1000 : published - server;
    window.drawn.push({
      total: nowMs - captured, queued: header.queuedUs / 1000, read: header.decodedUs / 1000, shade: header.shadedUs / 1000, wire: heardMs - published, decode: decodeMs,
      wait: nowMs - heardMs - decodeMs, encode: header.encodedUs / 1000, at: nowMs, bytes, format: header.format,
    });
  });
};

async function once(browser, url, query) {
  const page = await openPage(browser, `${url}${query}`);
  await untilFrames(page, 2 * FPS, 120000); // the pilot and the clock have settled
  await page.evaluate(note);
  await page.waitForTimeout(SECONDS * 1000);
  const drawn = await page.evaluate(() => window.drawn);
  await page.close();
  return drawn;
}

function line(name, drawn) {
  const column = (key, digits = 1) => at(drawn.map((d) => d[key]), 0.5).toFixed(digits).padStart(7);
  const gaps = drawn.slice(1).map((d, i) => d.at - drawn[i].at);
  const total = at(drawn.map((d) => d.total), 0.5);
  console.log([
    name.padEnd(34), drawn.at(-1).format.padEnd(5), (1000 / at(gaps, 0.5)).toFixed(1).padStart(5),
    column('total'), at(drawn.map((d) => d.total), 0.95).toFixed(1).padStart(7), column('queued'), column('read'), column('shade'), column('encode'),
    column('wire'), column('decode'), column('wait'), column('bytes', 0).padStart(8),
    total <= 1000 / FPS + 50 ? '  holds' : '  misses',
  ].join(' '));
}

async function measure(browser, name, program, args, codings) {
  const server = await startServer(program, args);
  const drawn = codings.map(() => []);
  for (let round = 0; round < ROUNDS; round++)
    for (const [i, query] of codings.entries()) drawn[i].push(...await once(browser, server.url, query));
  await server.stop();
  drawn.forEach((all) => line(name, all));
}

console.log(`target: ${(1000 / FPS + 50).toFixed(0)} ms; milliseconds, medians of ${ROUNDS} x ${SECONDS} s, total also at 95 %`);
console.log([
  ''.padEnd(34), 'coding', 'fps', '  total', '   95 %', ' queued', '   read', '  shade', ' encode', '   wire', ' decode', '   wait', '   bytes',
].join(' '));
const browser = await openBrowser();
const codings = ['?coding=jpeg', ''];
const folder = mkdtempSync(join(tmpdir(), 'relight-latency-'));

// The light-transport cache stored beside a scene, as a server finds it at its second start.
function makeCache(size) {
  const file = join(folder, `${size}.transport`);
  execFileSync(join(dirname(relightd), 'relight-render'),
    ['--method', 'cached', '--source', 'sky:', '--frames', '0-0', '--size', size, '--cache-file', file, '--out', join(folder, 'one.exr')],
    { stdio: 'ignore' });
  return file;
}

for (const size of (process.env.SIZES ?? '320x180,640x360,1280x720').split(',')) {
  const sky = ['--port', '0', '--fps', String(FPS), '--source', 'sky:speed=0.02', '--size', size];
  await measure(browser, `relightd, ${size}, first start`, relightd, [...sky, '--cache-file', 'off'], codings);
  await measure(browser, `relightd, ${size}, cache kept`, relightd, [...sky, '--cache-file', makeCache(size)], codings);
  if (pattern)
    await measure(browser, `no rendering, ${size}`, pattern, ['--fps', String(FPS), '--size', size, '--rough', '--h264'], codings);
}
await browser.close();
rmSync(folder, { recursive: true });
