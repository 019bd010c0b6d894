// The canvas pixel by pixel in both codings, and switching between them. pattern_server dumps what it drew and
// libjpeg-turbo's decoding of its JPEG. RELIGHT_PATTERN_SERVER names that program.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import {
  beginTests, openPage, readback, startServer, until, untilFrames, untilSentence, untilState, untilStatuses,
} from './lib.mjs';

const chromium = await beginTests(['RELIGHT_PATTERN_SERVER', 'RELIGHT_RELIGHTD']);
const PATTERN = chromium.RELIGHT_PATTERN_SERVER;
const BUILT_IN = process.env.RELIGHT_H264 === 'ON'; // the server offers H.264

let folder;
let decodes; // the browser's own answer
before(async () => {
  folder = mkdtempSync(join(tmpdir(), 'relight-video-'));
  const server = await startServer(PATTERN, []);
  const page = await openPage(chromium.browser, server.url);
  decodes = await page.evaluate(async () => isSecureContext && typeof VideoDecoder === 'function'
    && (await VideoDecoder.isConfigSupported({ codec: 'avc1.42E01F', optimizeForLatency: true })).supported);
  console.log(`H.264: the server ${BUILT_IN ? 'makes' : 'does not make'} it, the browser ${decodes ? 'decodes' : 'does not decode'} it`);
  await page.close();
  await server.stop();
});
after(() => {
  if (folder) rmSync(folder, { recursive: true });
});

const expected = () => (BUILT_IN && decodes ? 'h264' : 'jpeg');
const coding = (page) => page.evaluate(() => window.relight.lastHeader?.format);
const untilCoding = (page, name) => page.waitForFunction((n) => window.relight?.lastHeader?.format === n, name);

// A page gives H.264 up if nothing comes for seconds, which may happen to a starved one: it is loaded again.
async function untilExpected(page) {
  for (;;) { // as often as it takes
    await page.waitForFunction((n) => window.relight?.lastHeader?.format === n || (n === 'h264' && window.relight?.noVideo), expected());
    const why = await page.evaluate(() => window.relight.noVideo);
    if (!/nothing for 3 s|sent no H\.264/.test(why)) break;
    await page.reload();
    await untilFrames(page, 1);
  }
  await untilCoding(page, expected());
}

async function withPage(args, query, body, script) {
  const server = await startServer(PATTERN, ['--fps', '15', ...args]);
  const page = await chromium.browser.newPage({ viewport: { width: 500, height: 400 } });
  const faults = [];
  page.on('pageerror', (error) => faults.push(String(error)));
  try {
    if (script) await page.addInitScript(script);
    await page.goto(`${server.url}${query}`);
    await body(page, server);
    assert.deepEqual(faults, []);
  } finally {
    await page.close();
    await server.stop();
  }
}

// Stops the images, and returns the last one as displayed, as drawn and as decoded by libjpeg-turbo.
let dumps = 0;
async function lastPicture(page, server) {
  server.say('stop');
  const path = join(folder, `${++dumps}.rgb`);
  const told = server.text().length;
  server.say(`dump ${path}`);
  await until(() => /dumped frame (\d+)/.test(server.text().slice(told)));
  const frame = Number(server.text().slice(told).match(/dumped frame (\d+)/)[1]);
  await page.waitForFunction((n) => window.relight.lastHeader?.frame === n, frame);
  const shown = await readback(page);
  const bytes = readFileSync(path);
  assert.equal(bytes.length, shown.width * shown.height * 6);
  return { shown, drawn: bytes.subarray(0, bytes.length / 2), decoded: bytes.subarray(bytes.length / 2) };
}

// The canvas against RGB: the largest difference, the mean, and the peak signal to noise ratio.
function difference(rgba, rgb) {
  let most = 0;
  let sum = 0;
  let squares = 0;
  for (let i = 0, j = 0; j < rgb.length; i += 4, j += 3) {
    for (let c = 0; c < 3; c++) {
      const d = Math.abs(rgba[i + c] - rgb[j + c]);
      most = Math.max(most, d);
      sum += d;
      squares += d * d;
    }
  }
  return { most, mean: sum / rgb.length, psnr: 10 * Math.log10((255 * 255 * rgb.length) / Math.max(squares, 1)) };
}

const say = ({ most, mean, psnr }) => `${most} at most, ${mean.toFixed(2)} in the mean, ${psnr.toFixed(1)} dB`;

for (const [quality, sampling] of [[95, '4:4:4'], [80, '4:2:0']]) {
  test(`the canvas is what libjpeg-turbo decodes, quality ${quality}, ${sampling}`, () =>
    withPage(['--size', '322x182', '--rough', '--quality', String(quality)], '?coding=jpeg', async (page, server) => {
      await untilFrames(page, 5);
      for (let i = 0; i < 3; i++) {
        const { shown, drawn, decoded } = await lastPicture(page, server);
        const got = difference(shown.data, decoded);
        console.log(`against libjpeg-turbo: ${say(got)}; against what was drawn: ${say(difference(shown.data, drawn))}`);
        assert.ok(got.most <= 2, `off by ${got.most}`);
        server.say('go');
        await untilFrames(page, 3);
      }
    }));
}

test('H.264 shows the same frames in the same colours as JPEG', async (t) => {
  if (expected() !== 'h264') {
    t.skip('no H.264 here');
    return;
  }
  for (const args of [['--size', '320x180', '--quality', '95'], ['--size', '320x180', '--quality', '85', '--rough'],
    ['--size', '321x181', '--quality', '95']]) {
    await withPage(['--h264', '--fps', '20', ...args], '', async (page, server) => {
      await untilFrames(page, 10);
      await untilExpected(page);
      const { shown, drawn, decoded } = await lastPicture(page, server);
      const video = difference(shown.data, drawn);
      const jpeg = { data: Buffer.alloc(shown.data.length) };
      for (let i = 0, j = 0; j < decoded.length; i += 4, j += 3) decoded.copy(jpeg.data, i, j, j + 3);
      console.log(`${args.join(' ')}: H.264 ${say(video)}; JPEG ${say(difference(jpeg.data, drawn))}`);
      // Flat areas well inside a quarter, away from bar, edges and noise: the mean is the colour itself.
      const { width, height } = shown;
      const bar = (shown.header.frame * 8) % width;
      const near = (x) => [bar, bar - width].some((at) => x > at - 32 && x < at + 32);
      for (const [x0, y0] of [[0.1, 0.1], [0.7, 0.1], [0.1, 0.6], [0.7, 0.6]]) {
        if (near(Math.floor(x0 * width))) continue;
        const [sums, wants] = [[0, 0, 0], [0, 0, 0]];
        for (let y = 0; y < 16; y++)
          for (let x = 0; x < 16; x++) {
            const p = (Math.floor(y0 * height) + y) * width + Math.floor(x0 * width) + x;
            for (let c = 0; c < 3; c++) {
              sums[c] += shown.data[4 * p + c] / 256;
              wants[c] += drawn[3 * p + c] / 256;
            }
          }
        for (let c = 0; c < 3; c++)
          assert.ok(Math.abs(sums[c] - wants[c]) <= 3, `channel ${c} at ${x0}, ${y0}: ${sums[c].toFixed(1)} for ${wants[c].toFixed(1)}`);
      }
      // Colour finer than 4:2:0 is most of what both codings lose: noise, and edges at odd positions. How many bits an
      // image gets depends on when the last ones came.
      assert.ok(video.psnr > (args.includes('--rough') ? 23 : 30), say(video));
    });
  }
});

test('the page names the coding, and ?coding=jpeg forces one', async () => {
  for (const [query, want] of [['', expected()], ['?coding=jpeg', 'jpeg']]) {
    await withPage(BUILT_IN ? ['--h264'] : [], query, async (page) => {
      await untilState(page, 'live');
      await untilFrames(page, 5);
      await (query ? untilCoding(page, 'jpeg') : untilExpected(page));
      await page.waitForFunction((name) => document.getElementById('coding').textContent === name
        && document.getElementById('traffic').textContent.endsWith('bit/s'), want === 'h264' ? 'H.264' : 'JPEG');
    });
  }
});

test('a server without H.264 sends JPEG', () =>
  withPage([], '', async (page) => {
    await untilFrames(page, 3);
    assert.equal(await coding(page), 'jpeg');
  }));

// Possible faults of a browser. Without workers the page decodes by itself, so that a test can reach the decoder.
const inPage = 'delete window.Worker;';
const broken = {
  'has no WebCodecs': `${inPage} delete window.VideoDecoder;`,
  'says that it decodes no H.264': `${inPage} VideoDecoder.isConfigSupported = async () => ({ supported: false });`,
  'is not asked over a secure connection': `${inPage} Object.defineProperty(window, 'isSecureContext', { value: false });`,
  'cannot be configured after all': `${inPage} VideoDecoder.prototype.configure = () => { throw new DOMException('it is not supported', 'NotSupportedError'); };`,
  'fails in the middle': `${inPage} { const real = VideoDecoder.prototype.decode; let count = 0;
    VideoDecoder.prototype.decode = function (chunk) {
      if (++count > 8) throw new DOMException('broken', 'EncodingError');
      real.call(this, chunk);
    }; }`,
  'reads nonsense': `${inPage} { const Real = EncodedVideoChunk; let count = 0;
    window.EncodedVideoChunk = class { constructor(init) {
      if (++count > 8) init.data = new Uint8Array(init.data).fill(255, 5);
      return new Real(init);
    } }; }`,
  'swallows pictures in silence': `${inPage} { const real = VideoDecoder.prototype.decode; let count = 0;
    VideoDecoder.prototype.decode = function (chunk) { if (++count <= 8) real.call(this, chunk); }; }`,
};

// All are tried by one page, which is loaded again with the fault that window.name names: opening a page costs more than its images.
const chosen = `switch (window.name) {
  ${Object.entries(broken).map(([name, script]) => `case ${JSON.stringify(name)}: { ${script} break; }`).join('\n')}
}`;
test('a browser with a fault gets JPEG, without a reload and without a dark canvas', (t) =>
  withPage(BUILT_IN ? ['--h264'] : [], '', async (page) => {
    for (const name of Object.keys(broken)) {
      await t.test(`a browser that ${name}`, async () => {
        await page.evaluate((n) => { window.name = n; }, name);
        await page.reload();
        assert.equal(await page.evaluate(() => window.name), name);
        await page.evaluate(() => { window.same = true; });
        await untilFrames(page, 3);
        await page.evaluate(() => {
          window.darkest = 255;
          window.cleared = 0; // setting a side clears the canvas, even to its old value
          new MutationObserver((changes) => { window.cleared += changes.length; })
            .observe(document.getElementById('picture'), { attributes: true, attributeFilter: ['width', 'height'] });
          window.watching = setInterval(() => {
            const { data, width } = window.relight.readback();
            const at = 4 * (10 * width + 10); // red, or the bar's white
            window.darkest = Math.min(window.darkest, data[at]);
          }, 15);
        });
        await page.waitForFunction((gives) => window.relight.lastHeader?.format === 'jpeg' && (window.relight.noVideo || !gives), BUILT_IN && decodes);
        await untilFrames(page, 5);
        await untilState(page, 'live');
        assert.equal(await coding(page), 'jpeg');
        const seen = await page.evaluate(() => ({ same: window.same, darkest: window.darkest, cleared: window.cleared, why: window.relight.noVideo }));
        assert.ok(seen.same);
        assert.equal(seen.cleared, 0);
        assert.ok(seen.darkest > 150, `${seen.darkest}`);
        assert.ok(!decodes || !BUILT_IN || seen.why.length > 5, seen.why);
        console.log(`${name}: ${seen.why}`);
        await untilSentence(page, /^Live\.$/);
      });
    }
  }, chosen));

// The bit rate that the Statistics panel shows.
function shownBits(text) {
  const [, number, unit] = text.replaceAll('\u00a0', ' ').match(/^([\d.]+) ?(k|M|G)?bit\/s$/) ?? [0, NaN];
  return Number(number) * { k: 1e3, M: 1e6, G: 1e9 }[unit ?? ''];
}

for (const coding of ['h264', 'jpeg']) {
  test(`a thin line gets as many pictures and as wide ones as its address asks for, ${coding}, and says what they take`, async (t) => {
    if (coding === 'h264' && expected() !== 'h264') {
      t.skip('no H.264 here');
      return;
    }
    const server = await startServer(chromium.RELIGHT_RELIGHTD,
      ['--port', '0', '--size', '320x180', '--samples', '1', '--paths', 'direct', '--edge-rays', '1', '--method', 'mis', '--fps', '16', '--source', 'sky:size=128x64,speed=0.5',
        '--reseed', '--h264-mbit', '2']);
    const page = await chromium.browser.newPage({ viewport: { width: 500, height: 400 } });
    try {
      await page.goto(`${server.url}?rate=4&width=200${coding === 'jpeg' ? '&coding=jpeg' : ''}`);
      await untilFrames(page, 3); // the first image, a keyframe, is no longer included
      await (coding === 'h264' ? untilExpected(page) : untilCoding(page, coding));
      await page.evaluate(async () => {
        const { Rate } = await import('./figures.js');
        window.pictures = [];
        window.rate = new Rate();
        window.relight.app.on('picture', ({ header, bytes, heardMs }) => {
          window.pictures.push({ ...header, bits: 8 * (bytes + 80) });
          window.rate.add(heardMs - performance.timeOrigin, bytes + 80);
        });
      });
      await page.waitForFunction(() => window.pictures.length >= 24);
      const pictures = (await page.evaluate(() => window.pictures)).filter(({ format }) => format === coding);
      assert.ok(pictures.length > 12 && pictures.every(({ width, height }) => width === 160 && height === 90));
      assert.deepEqual(await readback(page).then((got) => [got.width, got.height]), [160, 90]);
      // By the server's clock. A busy one may have sent the first image late, but by how much is bounded.
      const seconds = (pictures.at(-1).publishedUs - pictures[0].publishedUs) / 1e6;
      assert.ok(pictures.length <= 4 * (seconds + 1) + 1, `${pictures.length} pictures in ${seconds} s`);
      // half the sides and a quarter of the rate: a sixteenth of the two million, with one second of buffer
      const bits = pictures.slice(1).reduce((sum, picture) => sum + picture.bits, 0);
      if (coding === 'h264') assert.ok(bits <= 1.1 * (2e6 / 16) * (seconds + 2), `${bits} bits`);
      await until(async () => { // where pictures come evenly both are the same
        const [shown, got] = await page.evaluate(() => [document.getElementById('traffic').textContent, 8 * window.rate.bytesPerSecond(performance.now())]);
        return Math.abs(shownBits(shown) / got - 1) < 0.15;
      });
    } finally {
      await page.close();
      await server.stop();
    }
  });
}

const setHidden = (page, hidden) => page.evaluate((h) => {
  Object.defineProperty(document, 'visibilityState', { value: h ? 'hidden' : 'visible', configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}, hidden);

test('a tab that slept resumes video at once, repeatedly', () =>
  withPage(BUILT_IN ? ['--h264'] : [], '', async (page) => {
    await untilFrames(page, 10);
    for (let i = 0; i < 3; i++) {
      await setHidden(page, true);
      await untilState(page, 'paused');
      await untilStatuses(page, 2); // by now everything under way has arrived
      const before = await page.evaluate(() => window.relight.frames);
      await untilStatuses(page, 2);
      assert.equal(await page.evaluate(() => window.relight.frames), before);
      const begun = Date.now();
      await setHidden(page, false);
      await untilFrames(page, 1);
      console.log(`awake after ${Date.now() - begun} ms`);
      await untilState(page, 'live');
      await untilFrames(page, 5);
      await untilExpected(page);
    }
  }));

test('a restarted server is found again, with video', () =>
  withPage(BUILT_IN ? ['--h264'] : [], '', async (page, server) => {
    await untilFrames(page, 10);
    await server.stop();
    await untilState(page, 'reconnecting');
    const again = await startServer(PATTERN, ['--port', server.port, ...(BUILT_IN ? ['--h264'] : [])]);
    try {
      const begun = Date.now();
      await untilFrames(page, 3);
      console.log(`pictures ${Date.now() - begun} ms after the server listens again`);
      await untilExpected(page);
      await untilState(page, 'live');
    } finally {
      await again.stop();
    }
  }));

test('a page opened on a still image shows it', () =>
  withPage(BUILT_IN ? ['--h264'] : [], '', async (first, server) => {
    await untilFrames(first, 30); // more than the server keeps: a new viewer needs a keyframe
    server.say('state ended');
    const { shown } = await lastPicture(first, server);
    const second = await openPage(chromium.browser, server.url);
    try {
      await second.waitForFunction((n) => window.relight.lastHeader?.frame === n, shown.header.frame);
      await untilExpected(second);
      await untilState(second, 'ended');
      const { psnr } = difference((await readback(second)).data, rgbOf(shown.data));
      assert.ok(psnr > 30, `${psnr}`);
      await second.goto(`${server.url}?coding=jpeg`);
      await untilCoding(second, 'jpeg');
    } finally {
      await second.close();
    }
  }));

function rgbOf(rgba) {
  const rgb = Buffer.alloc((rgba.length / 4) * 3);
  for (let i = 0, j = 0; i < rgba.length; i += 4, j += 3) rgba.copy(rgb, j, i, i + 3);
  return rgb;
}

test('an image of a new size continues in the same coding', () =>
  withPage(BUILT_IN ? ['--h264'] : [], '', async (page, server) => {
    await untilFrames(page, 5);
    for (const [width, height] of [[640, 352], [273, 481], [320, 184]]) {
      server.say(`size ${width}x${height}`);
      await page.waitForFunction(([w, h]) => window.relight.lastHeader?.width === w && window.relight.lastHeader.height === h,
        [width, height]);
      const got = await readback(page);
      assert.deepEqual([got.width, got.height], [width, height]);
      await untilExpected(page);
    }
  }));

test('a page that draws nothing for a while is soon at the newest image, in an unbroken chain', () =>
  withPage(['--fps', '60', ...(BUILT_IN ? ['--h264'] : [])], '', async (page) => {
    await untilFrames(page, 3);
    const before = await page.evaluate(() => {
      window.realFrame = window.requestAnimationFrame;
      window.requestAnimationFrame = (then) => { window.held = then; return 1; };
      return window.relight.lastHeader.frame;
    });
    await page.waitForFunction((n) => window.relight.status.frame >= n + 120, before, { polling: 100 });
    await page.evaluate(() => {
      window.requestAnimationFrame = window.realFrame;
      window.held?.();
    });
    await page.waitForFunction((n) => window.relight.lastHeader.frame > n + 60, before);
    await untilState(page, 'live');
    await untilFrames(page, 30);
    await untilExpected(page);
  }));
