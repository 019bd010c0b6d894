// Snapshots and comparison in Chromium with the whole program: pixels read back from the canvas and from saved files.
// RELIGHT_RELIGHTD names the server program.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { inflateSync } from 'node:zlib';
import { beginTests, openPage, readback, startServer, untilFrames } from './lib.mjs';

const chromium = await beginTests(['RELIGHT_RELIGHTD']);
const RELIGHTD = chromium.RELIGHT_RELIGHTD;

const WIDTH = 96;
const HEIGHT = 54;
const STILL = ['--source', 'sky:size=256x128,hour=9', '--frames', '2-2', '--once', '--converge', 'off', '--method', 'mis', '--samples', '8'];
const MOVING = ['--source', 'sky:size=64x32,time=10:00,speed=20', '--fps', '10', '--samples', '4', '--method', 'mis'];

async function withPage(args, body, options) {
  const server = await startServer(RELIGHTD, ['--port', '0', '--size', `${WIDTH}x${HEIGHT}`, '--edge-rays', '1', ...args]);
  const page = await openPage(chromium.browser, `${server.url}?coding=jpeg`, options);
  try {
    await page.waitForFunction(() => window.relight?.frames > 0 && window.relight.status?.frames?.used > 0);
    await body(page);
    assert.deepEqual(page.faults, []);
  } finally {
    await page.close();
    await server.stop();
  }
}

// A group of tests on one page, in this order: opening a page costs as much processor time as three seconds of images.
const onOnePage = (title, args, tests) => test(title, (t) => withPage(args, async (page) => {
  for (const [name, body] of Object.entries(tests)) await t.test(name, () => body(page));
}));

// The file saved by an action: {name, bytes}.
async function saved(page, act) {
  const [download] = await Promise.all([page.waitForEvent('download'), act()]);
  return { name: download.suggestedFilename(), bytes: readFileSync(await download.path()) };
}

// Decodes an 8-bit PNG without interlacing, as browsers write it: {width, height, data of RGB}.
function readPng(bytes) {
  const parts = [];
  let at = 8;
  let [width, height, channels] = [0, 0, 0];
  while (at < bytes.length) {
    const size = bytes.readUInt32BE(at);
    const type = bytes.toString('latin1', at + 4, at + 8);
    const body = bytes.subarray(at + 8, at + 8 + size);
    if (type === 'IHDR') [width, height, channels] = [body.readUInt32BE(0), body.readUInt32BE(4), { 2: 3, 6: 4 }[body[9]]];
    if (type === 'IDAT') parts.push(body);
    at += 12 + size;
  }
  const raw = inflateSync(Buffer.concat(parts));
  const row = width * channels;
  const lines = Buffer.alloc(row * height);
  for (let y = 0; y < height; y++)
    for (let i = 0; i < row; i++) {
      const left = i >= channels ? lines[y * row + i - channels] : 0;
      const up = y ? lines[(y - 1) * row + i] : 0;
      const corner = y && i >= channels ? lines[(y - 1) * row + i - channels] : 0;
      const [p, pa, pb, pc] = [left + up - corner, Math.abs(up - corner), Math.abs(left - corner), Math.abs(left + up - 2 * corner)];
      const paeth = pa <= pb && pa <= pc ? left : pb <= pc ? up : corner;
      const guess = [0, left, up, (left + up) >> 1, paeth][raw[y * (row + 1)]];
      assert.ok(Number.isFinite(p));
      lines[y * row + i] = raw[y * (row + 1) + 1 + i] + guess;
    }
  return { width, height, data: Buffer.from(lines.filter((_, i) => channels === 3 || i % 4 < 3)) };
}

const withoutAlpha = (data) => Buffer.from(data.filter((_, i) => i % 4 < 3));
const nameOf = (header, extension) =>
  `relight_frame_${header.frame}_${new Date(header.publishedUs / 1000).toISOString().slice(0, 19).replaceAll(':', '-')}Z.${extension}`;

const leftSide = (page) => page.evaluate(() => {
  const { left } = window.relight.compare;
  return [...left.getContext('2d').getImageData(0, 0, left.width, left.height).data];
});
// Waits until the paused sky's image is drawn and the server, four statuses later, has sent no other.
const pause = async (page, more = {}) => {
  await page.evaluate((m) => {
    window.quiet = 0;
    if (!window.watched) {
      window.relight.app.on('picture', () => { window.quiet = 0; });
      window.relight.app.on('status', (status) => {
        const there = status.source.state === 'paused' && status.frame === window.relight.lastHeader.frame && !status.preparing;
        window.quiet = there ? window.quiet + 1 : 0;
      });
      window.watched = true;
    }
    window.relight.app.send({ op: 'control', request: 1, paused: true, ...m });
  }, more);
  await page.waitForFunction((hour) => window.quiet >= 4 &&
    (hour === undefined || Math.abs(window.relight.status.source.hour - hour) < 1e-3), more.hour);
};

// The divider's position as a share of the displayed image.
const handleAt = (page) => page.evaluate(([width, height]) => {
  const box = document.getElementById('picture').getBoundingClientRect();
  const scale = Math.min(box.width / width, box.height / height);
  const left = box.left + (box.width - scale * width) / 2;
  return (document.getElementById('compare-handle').getBoundingClientRect().left - left) / (scale * width);
}, [WIDTH, HEIGHT]);

onOnePage('a still sky', STILL, {
  async 'PNG has the canvas’s pixels, by key and by button'(page) {
    const seen = await readback(page);
    for (const act of [() => page.keyboard.press('s'), () => page.click('#snapshot-png')]) {
      const { name, bytes } = await saved(page, act);
      assert.equal(name, nameOf(seen.header, 'png'));
      const png = readPng(bytes);
      assert.deepEqual([png.width, png.height], [WIDTH, HEIGHT]);
      assert.ok(png.data.equals(withoutAlpha(seen.data)));
    }
  },

  async 'EXR works for a still sky, by key and by button, repeatedly'(page) {
    for (const act of [() => page.keyboard.press('Shift+S'), () => page.click('#snapshot-exr')]) {
      const { name, bytes } = await saved(page, act);
      assert.match(name, /^relight_frame_2_.*Z\.exr$/);
      assert.equal(bytes.readUInt32LE(0), 20000630); // OpenEXR's magic number
      assert.ok(bytes.includes('dataWindow') && bytes.length > WIDTH * HEIGHT);
      await page.waitForFunction(() => !document.getElementById('snapshot-exr').disabled);
    }
  },

  async 'the divider follows a drag and the arrow keys without rotating the sky'(page) {
    await page.keyboard.press('k');
    assert.ok(Math.abs(await handleAt(page) - 0.5) < 0.01);
    const box = await page.locator('#picture').boundingBox();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    await page.mouse.move(x, y);
    await page.mouse.down();
    await page.mouse.move(x - 0.3 * box.width, y + 5, { steps: 4 });
    await page.mouse.up();
    const dragged = await handleAt(page);
    assert.ok(dragged < 0.35, `${dragged}`);
    const clip = await page.$eval('#compare-kept', (e) => getComputedStyle(e).clipPath);
    assert.ok(Math.abs(Number.parseFloat(clip.split(' ')[1]) - 100 * (1 - dragged)) < 0.2, clip);
    await page.focus('#compare-handle');
    await page.keyboard.press('ArrowRight');
    assert.ok(Math.abs(await handleAt(page) - dragged - 0.01) < 0.004);
    await page.keyboard.press('Shift+ArrowRight');
    assert.ok(Math.abs(await handleAt(page) - dragged - 0.11) < 0.004);
    await page.keyboard.press('End');
    assert.equal(await page.getAttribute('#compare-handle', 'aria-valuenow'), '100');
    await page.keyboard.press('Home');
    assert.ok(Math.abs(await handleAt(page)) < 0.004);
    assert.equal(await page.evaluate(() => window.relight.app.control?.rotate_degrees ?? 0), 0);
    assert.equal(await page.evaluate(() => window.relight.probe.pixel), null, 'a drag asks about no pixel');
  },
});

onOnePage('a moving sky', [...MOVING, '--converge', 'off'], {
  async 'EXR of a moving sky is at least as new as the displayed image'(page) {
    await saved(page, () => page.click('#snapshot-exr')); // the server now has an old one
    await page.waitForFunction(() => !document.getElementById('snapshot-exr').disabled);
    await untilFrames(page, 10);
    const frame = await page.evaluate(() => window.relight.lastHeader.frame);
    const { name } = await saved(page, () => page.click('#snapshot-exr'));
    assert.ok(Number(name.match(/frame_(\d+)_/)[1]) >= frame, `${name}, frame ${frame} was seen`);
  },

  async 'the kept image and its label stay while the live one continues'(page) {
    await pause(page);
    const seen = await readback(page);
    await page.keyboard.press('k');
    assert.deepEqual(await leftSide(page), [...seen.data]);
    assert.equal(await page.textContent('#compare-a'), `Kept: mis, 4 samples, frame ${seen.header.frame}`);
    await page.evaluate(() => window.relight.app.send({ op: 'control', request: 2, method: 'uniform', samples: 1, paused: false }));
    await page.waitForFunction(() => /^Live: uniform, 1 sample,/.test(document.getElementById('compare-b').textContent));
    await page.waitForFunction((frame) => window.relight.lastHeader.frame > frame + 3, seen.header.frame);
    assert.deepEqual(await leftSide(page), [...seen.data]);
    assert.equal(await page.textContent('#compare-a'), `Kept: mis, 4 samples, frame ${seen.header.frame}`);
    await page.waitForFunction(() => /different sky frame/.test(document.getElementById('compare-remark').textContent));
    await pause(page);
    const live = await readback(page);
    assert.equal(await page.textContent('#compare-b'), `Live: uniform, 1 sample, frame ${live.header.frame}`);
    await page.click('#compare-anew');
    assert.deepEqual(await leftSide(page), [...live.data]);
    await page.keyboard.press('k');
    assert.ok(await page.isHidden('#compare-handle') && await page.isHidden('#compare-bar') && await page.isHidden('#compare-kept'));
    assert.equal(await page.getAttribute('#compare-button', 'aria-pressed'), 'false');
  },

  async 'the difference is eight times the absolute one, and its numbers match the pixels'(page) {
    await pause(page);
    const kept = (await readback(page)).data;
    await page.click('#compare-button');
    await page.keyboard.press('x');
    assert.ok((await leftSide(page)).every((v, i) => v === (i % 4 === 3 ? 255 : 0)), 'of a picture and itself there is none');
    await pause(page, { hour: 18 });
    assert.equal(await page.evaluate(() => window.relight.status.light.time), '18:00');
    const live = (await readback(page)).data;
    const shown = await leftSide(page);
    let [sum, wrong] = [0, 0];
    shown.forEach((v, i) => {
      if (i % 4 === 3) return;
      const d = Math.abs(live[i] - kept[i]);
      sum += d;
      wrong += v !== Math.min(255, 8 * d);
    });
    assert.equal(wrong, 0);
    const mean = sum / (3 * WIDTH * HEIGHT);
    assert.ok(mean > 1, `the evening differs from the morning: ${mean}`);
    await page.evaluate(() => window.relight.compare.say());
    const words = await page.textContent('#compare-remark');
    assert.ok(words.startsWith(`mean difference ${mean.toFixed(mean < 9.95 ? 2 : 0)} of 255, 95th percentile`), `${words}, ${mean} is meant`);
  },
});

test('against the reference that accumulates while the sky stands still', () =>
  withPage(['--source', 'sky:size=256x128,hour=9', '--frames', '2-2', '--once', '--method', 'mis', '--samples', '1'], async (page) => {
    await page.waitForFunction(() => window.relight.status.light.passes > 0);
    await page.keyboard.press('k');
    // One sample a pass: samples come with the image and passes with the status, so that either may be ahead for a moment.
    await page.waitForFunction(() => {
      const [, samples, passes] = document.getElementById('compare-b').textContent.match(/^Live: mis, (\d+) samples, (\d+) passes/) ?? [];
      return samples > 1 && samples === passes;
    });
  }, { width: 390, height: 844 }));

test('on a phone the comparison hides nothing of the picture but the boundary', () => withPage(STILL, async (page) => {
  await page.click('#compare-button');
  for (const [width, height] of [[390, 844], [844, 390]]) {
    await page.setViewportSize({ width, height });
    await page.evaluate(() => new Promise((laid) => { requestAnimationFrame(() => requestAnimationFrame(laid)); }));
    await page.waitForFunction(() => !document.getElementById('toast').textContent); // it disappears by itself
    const got = await page.evaluate(() => {
      const { left, top, width: w, height: h } = window.relight.compare.box();
      const boxes = ['compare-a', 'compare-b', 'compare-bar', 'compare-end'].map((id) => [id, document.getElementById(id).getBoundingClientRect().toJSON()]);
      return { picture: { left, top, right: left + w, bottom: top + h }, boxes, window: [innerWidth, innerHeight] };
    });
    for (const [id, box] of got.boxes) {
      assert.ok(box.width > 10 && box.height > 5, `${id} is not there`);
      const apart = box.left >= got.picture.right || box.right <= got.picture.left || box.top >= got.picture.bottom - 0.5 || box.bottom <= got.picture.top;
      assert.ok(apart, `${id} covers the picture: ${JSON.stringify(box)} over ${JSON.stringify(got.picture)}`);
      assert.ok(box.left >= 0 && box.right <= got.window[0] && box.bottom <= got.window[1], `${id} is not in the window: ${JSON.stringify(box)}`);
    }
    assert.ok(got.picture.bottom - got.picture.top > 0.45 * Math.min(width * 9 / 16, height), 'hardly a picture is left');
  }
}, { width: 390, height: 844 }));
