// Any server that prints its address, viewed in Chromium: do images arrive, move and look like a lit scene?
// RELIGHT_STREAM_COMMAND is a JSON array of program and arguments; $RELIGHT_TEST_DATA in them is replaced.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import {
  brightness, beginTests, openPage, readback, sentence, startServer, untilFrames, untilSentence, untilState,
} from './lib.mjs';

const command = process.env.RELIGHT_STREAM_COMMAND ?? '';
const data = process.env.RELIGHT_TEST_DATA;
const chromium = await beginTests([], () => (command ? undefined : 'RELIGHT_STREAM_COMMAND is not set')
  ?? (command.includes('$RELIGHT_TEST_DATA') && !data ? 'RELIGHT_TEST_DATA is not set' : undefined));
const [program, ...args] = JSON.parse(command).map((word) => word.replaceAll('$RELIGHT_TEST_DATA', data));

// One page for all tests, in this order: opening one costs as much processor time as three seconds of images.
let server;
let page;
before(async () => {
  server = await startServer(program, args);
  page = await openPage(chromium.browser, server.url);
});
after(async () => {
  await page?.close();
  await server?.stop();
});

// Mean brightness over rows [from, to) of the image, 0..255.
function meanOf({ width, height, data }, from, to) {
  let sum = 0;
  let count = 0;
  for (let y = Math.floor(from * height); y < Math.floor(to * height); y++)
    for (let x = 0; x < width; x++, count++) sum += brightness(data, (y * width + x) * 4);
  return sum / count;
}

// Share of the pixels that differ by more than two code values.
function moved(a, b) {
  let count = 0;
  for (let i = 0; i < a.data.length; i += 4) if (Math.abs(brightness(a.data, i) - brightness(b.data, i)) > 2) count++;
  return count / (a.width * a.height);
}

// The number of different brightnesses, as a share of 256: a flat or torn image has few.
function tones({ data }) {
  const seen = new Set();
  for (let i = 0; i < data.length; i += 4) seen.add(Math.round(brightness(data, i)));
  return seen.size / 256;
}

test('images of a lit scene arrive and move', async () => {
  await page.waitForFunction(() => window.relight?.frames > 0);
  const pictures = [await readback(page)];
  do { // at least eight, and until the sky has moved
    await untilFrames(page, 1);
    pictures.push(await readback(page));
  } while (pictures.length <= 8 || moved(pictures[0], pictures.at(-1)) <= 0.01);
  const last = pictures.at(-1);
  for (const picture of pictures) {
    const mean = meanOf(picture, 0, 1);
    assert.ok(mean > 20 && mean < 235, `mean brightness ${mean.toFixed(1)} of frame ${picture.header.frame}`);
    assert.ok(tones(picture) > 0.2, `${(tones(picture) * 256).toFixed(0)} tones only`);
  }
  // Sky and ground may be alike at some hour; eight bands of a lit scene are not.
  const bands = Array.from({ length: 8 }, (_, k) => meanOf(last, k / 8, (k + 1) / 8));
  const range = Math.max(...bands) - Math.min(...bands);
  assert.ok(range > 5, `bands ${bands.map((b) => b.toFixed(1)).join(' ')} are alike`);
  const share = moved(pictures[0], last);
  console.log(`frames ${pictures[0].header.frame}..${last.header.frame}, ${last.width} x ${last.height}, mean brightness `
    + `${meanOf(last, 0, 1).toFixed(1)}, bands differ by ${range.toFixed(1)}, ${(share * 100).toFixed(1)} % moved`);
  // numbers rise, or restart where the sequence does; each image is another
  assert.equal(new Set(pictures.map((p) => p.header.sequence)).size, pictures.length);
  assert.ok(new Set(pictures.map((p) => p.header.frame)).size >= pictures.length / 2, 'the sky frames do not advance');
  assert.deepEqual(page.faults, []);
});

test('the page describes what it shows, and how fast', async () => {
  await page.waitForFunction(() => window.relight?.frames > 2);
  await page.waitForFunction(() => window.relight.status?.scene && window.relight.status?.samples > 0);
  assert.match(await page.textContent('#about'), /^[^/]+ under [^/]+; \d+\u00a0×\u00a0\d+, \d+ samples per point, method \S+\.$/);
  const { width, height, header } = await readback(page);
  assert.deepEqual([width, height], [header.width, header.height]);
  assert.ok(header.shadedUs > 0 && header.encodedUs > 0, 'stage times are missing');
  assert.ok(header.gain > 0 && header.samples > 0);
  assert.ok((await sentence(page)).length > 4);
});

test('a second viewer does not affect the first', async () => {
  const second = await openPage(chromium.browser, server.url);
  try {
    await second.waitForFunction(() => window.relight?.frames > 0);
    await untilFrames(page, 2);
  } finally {
    await second.close();
  }
  await untilFrames(page, 2);
  await untilState(page, 'live');
});

test('the page notices when the server exits', async () => {
  await page.waitForFunction(() => window.relight?.frames > 0);
  const { code, signal } = await server.stop();
  assert.ok(code === 0 && signal === null, `the server ended with ${code ?? signal}:\n${server.text()}`);
  await untilSentence(page, /Retrying$/);
});
