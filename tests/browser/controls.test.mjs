// Every control of the page against the server's settings, observed by a separate connection. RELIGHT_RELIGHTD names
// the server program.
import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { beginTests, openPage, startServer, untilFrames } from './lib.mjs';

const chromium = await beginTests(['RELIGHT_RELIGHTD']);
const RELIGHTD = chromium.RELIGHT_RELIGHTD;

let folder;
before(() => {
  folder = mkdtempSync(join(tmpdir(), 'relight-controls-'));
  for (let i = 0; i < 20; i++) { // grey skies, each brighter than the previous one
    const texel = Buffer.from([128 + i, 128, 128, 129]);
    writeFileSync(join(folder, `sky.${100 + i}.hdr`), Buffer.concat([
      Buffer.from('#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n'), ...Array(32).fill(texel)]));
  }
});
after(() => {
  if (folder) rmSync(folder, { recursive: true });
});

const CHEAP = ['--port', '0', '--size', '96x54', '--samples', '4', '--fps', '10', '--threads', '1', '--allow-bias', '0', '--paths', 'direct', '--edge-rays', '1',
  '--max-picture-seconds', '86400'];
const SKY = ['--source', 'sky:size=64x32,time=10:00,speed=0.01']; // daylight for an hour, however long a test takes
const MINUTES = ['--source', 'sky:size=64x32,time=10:00,speed=1']; // steps of a minute
const files = () => ['--source', join(folder, 'sky.%d.hdr')];

// An observing connection, from one page for all tests: witness.control() and witness.status() are the server's latest messages.
let witnessPage;
async function openWitness(url) {
  witnessPage ??= await chromium.browser.newPage();
  const page = witnessPage;
  await page.goto(new URL('/healthz', url).href);
  await page.evaluate(() => {
    window.said = {};
    window.pictures = 0;
    const socket = new WebSocket(`ws://${location.host}/ws`, 'relight.v1');
    window.tell = (message) => socket.send(JSON.stringify(message));
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => window.tell({ op: 'hello', role: 'controller', version: { major: 1, minor: 1 } });
    socket.onmessage = ({ data }) => {
      if (typeof data !== 'string') return;
      const message = JSON.parse(data);
      window.said[message.op] = message;
    };
  });
  await page.waitForFunction(() => window.said.control && window.said.status);
  return {
    until: (what, value) => page.waitForFunction(what, value),
    control: () => page.evaluate(() => window.said.control),
    status: () => page.evaluate(() => window.said.status),
    say: (message) => page.evaluate((m) => window.tell(m), message),
    close: () => page.goto('about:blank'),
  };
}

// Waits until these settings are in force.
const inForce = (witness, wanted) => witness.until(
  (want) => Object.entries(want).every(([key, value]) => window.said.control[key] === value), wanted);

// Waits for a short message of the page, which may have disappeared by now: window.toasts has all.
const untilToast = (page, pattern) => page.waitForFunction((text) => window.toasts.some((toast) => new RegExp(text).test(toast)), pattern.source);

async function withAll(args, body, { hash = '', ...options } = {}) {
  const server = await startServer(RELIGHTD, [...CHEAP, ...args]);
  const page = await openPage(chromium.browser, server.url + hash, options);
  await page.evaluate(() => {
    window.toasts = [];
    const toast = document.getElementById('toast');
    new MutationObserver(() => window.toasts.push(toast.textContent)).observe(toast, { childList: true, characterData: true, subtree: true });
  });
  const witness = await openWitness(server.url);
  try {
    await page.waitForFunction(() => window.relight?.frames > 0 && window.relight.app.control && window.relight.app.status?.offers,
      null);
    await body(page, witness, server);
    assert.deepEqual(page.faults, []);
  } finally {
    await witness.close();
    await page.close();
    await server.stop();
  }
}

// A group of tests on one page, in this order, each of which finds the settings as the one before has left them: opening a page
// costs as much processor time as three seconds of images.
const onOnePage = (title, args, tests) => test(title, (t) => withAll(args(), async (...all) => {
  for (const [name, body] of Object.entries(tests)) await t.test(name, () => body(...all));
}));

const setRange = (page, id, value) => page.$eval(`#${id}`, (input, v) => {
  input.value = v;
  input.dispatchEvent(new Event('input', { bubbles: true }));
}, value);

onOnePage('one page under a computed sky', () => SKY, {
  async 'the keys in docs/viewer.md are those of the page'(page) {
    const text = readFileSync(new URL('../../docs/viewer.md', import.meta.url), 'utf8');
    const written = [...text.matchAll(/^\| (`[^|]+) \| ([^|]+) \|$/gm)]
      .map(([, keys, label]) => `${keys.replaceAll('`', '')}: ${label}`);
    await page.keyboard.press('?');
    const listed = await page.$$eval('#help tr', (rows) => rows.map((row) => `${row.cells[0].textContent}: ${row.cells[1].textContent}`));
    assert.deepEqual(written.filter((row) => !listed.includes(row)), []); // other panels may add keys
    assert.ok(written.length >= 20);
    await page.keyboard.press('?');
  },

  async 'a refused change is reported, and the control reverts'(page) {
    await page.evaluate(() => { window.relight.controls.ask({ camera: 'nowhere' }); });
    await untilToast(page, /no camera 'nowhere'/);
    assert.equal(await page.inputValue('#set-camera'), 'main');
    page.faults.length = 0;
  },

  async 'Alt-drag moves the camera and not the sky, and V saves the view'(page, witness) {
    const box = await page.locator('#picture').boundingBox();
    await page.waitForFunction(() => window.relight.status?.view?.startsWith('@'));
    const before = (await witness.status()).view;
    await page.keyboard.down('Alt');
    await page.mouse.move(box.x + 100, box.y + 100);
    await page.mouse.down();
    await page.mouse.move(box.x + 100 + box.width / 8, box.y + 100, { steps: 4 });
    await page.mouse.up();
    await page.keyboard.up('Alt');
    await page.waitForFunction((was) => { // views on the way may be shown before
      const { view, camera } = window.relight.status;
      const [[from, about], [to]] = [was, view].map((v) => v.slice(1).split(';').map((p) => p.split(',').map(Number)));
      const at = ([x, , z]) => Math.atan2(x - about[0], z - about[2]);
      return camera === view && window.relight.app.control.camera === view && Math.abs(Math.abs(at(from) - at(to)) - Math.PI / 8) < 1e-3;
    }, before);
    const { control } = { control: await witness.control() };
    assert.equal(control.rotate_degrees, 0);
    // an eighth of the width is an eighth of half a turn about the point looked at, at the same height
    const [[x, y, z], [tx, ty, tz]] = [before, control.camera].map((v) => v.slice(1).split(';')[0].split(',').map(Number));
    const [cx, , cz] = before.split(';')[1].split(',').map(Number);
    assert.ok(Math.abs(y - ty) < 1e-3);
    const turned = Math.atan2(x - cx, z - cz) - Math.atan2(tx - cx, tz - cz);
    assert.ok(Math.abs(Math.abs(turned) - Math.PI / 8) < 1e-3, `turned by ${turned}`);
    page.once('dialog', (dialog) => dialog.accept('my view'));
    await page.keyboard.press('v');
    const offered = (there) => page.waitForFunction(
      (is) => [...document.querySelector('#set-camera').options].some((o) => o.value === 'my view') === is, there);
    await offered(true);
    assert.equal(await page.isVisible('#forget-view'), false); // the free view is shown, not the saved one
    await page.selectOption('#set-camera', 'my view');
    await inForce(witness, { camera: 'my view' });
    await page.click('#forget-view');
    await offered(false);
    await inForce(witness, { camera: control.camera }); // what was shown stays
    await page.waitForFunction(() => document.querySelector('#forget-view').hidden);
  },

  async 'a drag across the image rotates the sky, a click does not'(page, witness) {
    const box = await page.locator('#picture').boundingBox();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    await page.evaluate(() => {
      window.clicks = 0;
      document.getElementById('picture').addEventListener('click', () => { window.clicks++; });
    });
    await page.mouse.move(x, y);
    await page.mouse.down();
    for (let i = 1; i <= 8; i++) await page.mouse.move(x + (i * box.width) / 32, y);
    await page.mouse.up();
    await inForce(witness, { rotate_degrees: -30 }); // a quarter of the width, which is 120 degrees
    assert.equal(await page.evaluate(() => window.clicks), 0);
    await page.mouse.click(x, y);
    assert.equal(await page.evaluate(() => window.clicks), 1);
    assert.equal((await witness.control()).rotate_degrees, -30);
  },

  async 'every control of the panel changes its setting'(page, witness) {
    assert.equal(await page.textContent('#role'), 'Controlling');
    await setRange(page, 'set-rotate', 90);
    await inForce(witness, { rotate_degrees: 90 });
    const before = await page.evaluate(() => window.relight.lastHeader.gain);
    await setRange(page, 'set-exposure', 2);
    await inForce(witness, { bias_stops: 2, exposure_stops: null });
    await page.waitForFunction((gain) => window.relight.lastHeader.gain > 2.5 * gain, before); // with that in the image
    const { gain } = await page.evaluate(() => window.relight.lastHeader);
    await page.selectOption('#exposure-mode', 'fixed');
    await witness.until(() => typeof window.said.control.exposure_stops === 'number');
    const { exposure_stops: fixed } = await witness.control();
    assert.ok(Math.abs(Math.log2(gain) - fixed) < 1, `fixed at ${fixed}, the gain was ${gain}`); // no jump
    await setRange(page, 'set-exposure', fixed - 1);
    await witness.until((v) => Math.abs(window.said.control.exposure_stops - v) < 0.1, fixed - 1);
    await page.selectOption('#exposure-mode', 'auto');
    await inForce(witness, { exposure_stops: 'auto', bias_stops: 0 });
    await page.selectOption('#exposure-mode', 'follow');
    await inForce(witness, { exposure_stops: null, bias_stops: 0 });
    await page.selectOption('#set-tone', 'linear');
    await inForce(witness, { tone: 'linear' });
    await page.selectOption('#set-paths', 'all');
    await inForce(witness, { paths: 'all' });
    await page.selectOption('#set-paths', 'direct');
    await page.selectOption('#set-effort', 'noise 0.1');
    await inForce(witness, { error: 0.01, counted: false });
    await page.selectOption('#set-effort', 'time');
    await inForce(witness, { error: null, counted: false });
    await page.selectOption('#set-effort', 'samples 8');
    await inForce(witness, { samples: 8, counted: true, error: null });
    await page.selectOption('#set-effort', 'time');
    await inForce(witness, { counted: false });
    await page.selectOption('#set-method', 'faces');
    await inForce(witness, { method: 'faces', counted: true });
    await page.waitForFunction(() => ![...document.getElementById('set-effort').options].some((o) => o.value === 'time'));
    await page.selectOption('#set-fps', '5');
    await inForce(witness, { fps: 5 });
    await witness.until(() => window.said.status.method === 'faces' && window.said.status.samples === 8);
  },

  async 'changes by another controller are shown and announced'(page, witness) {
    await page.evaluate(() => { window.toasts.length = 0; });
    await witness.say({ op: 'control', request: 1, tone: 'reinhard', rotate_degrees: -45, exposure_stops: 3 });
    await page.waitForFunction(() => document.getElementById('set-tone').value === 'reinhard');
    assert.equal(await page.textContent('#set-rotate-text'), '-45°');
    assert.equal(await page.inputValue('#set-rotate'), '-45');
    assert.equal(await page.inputValue('#exposure-mode'), 'fixed');
    assert.equal(await page.textContent('#set-exposure-text'), '+3.0 EV');
    await untilToast(page, /^Another controller changed .*rotation: -45°.*tone curve: reinhard/);
    await witness.say({ op: 'control', request: 2, paused: true });
    await page.waitForFunction(() => document.getElementById('play').title === 'Resume the sky');
    // our own changes are not announced as another controller's
    await page.selectOption('#set-tone', 'filmic');
    await inForce(witness, { tone: 'filmic' });
    await page.waitForFunction(() => window.relight.app.control.tone === 'filmic');
    assert.ok(!/tone curve: filmic/.test(await page.evaluate(() => window.toasts.join('; '))));
  },

  async 'a waiting user is told why, until the answer arrives'(page, witness, server) {
    server.kill('SIGSTOP'); // simulates an endless render
    try {
      await setRange(page, 'set-rotate', 33);
      await page.evaluate(() => { window.toasts.length = 0; });
      await untilToast(page, /^Waiting for the server/);
    } finally {
      server.kill('SIGCONT');
    }
    await inForce(witness, { rotate_degrees: 33 });
    await page.waitForFunction(() => !document.getElementById('toast').textContent.startsWith('Waiting for the server'));
  },
});

test('the old image stays while a new camera’s view is prepared', () =>
  withAll([...SKY], async (page, witness) => {
    const seen = await page.evaluate(() => {
      const lit = () => window.relight.readback().data.some((v, i) => i % 4 < 3 && v > 30);
      window.dark = 0;
      setInterval(() => { window.dark += !lit(); }, 100);
      window.relight.app.on('picture', () => { window.dark += !lit(); });
      return [...document.getElementById('set-camera').options].map((o) => o.value);
    });
    assert.deepEqual(seen, ['main', 'sundial', 'gallery']);
    await page.selectOption('#set-camera', 'gallery');
    await witness.until(() => window.said.status.camera === 'gallery' && window.said.status.preparing === null);
    await inForce(witness, { camera: 'gallery' });
    await page.waitForFunction(() => window.relight.status.camera === 'gallery' && window.relight.status.preparing === null);
    await untilFrames(page, 1);
    assert.equal(await page.evaluate(() => window.dark), 0);
    assert.ok(!(await page.isVisible('#camera-progress')));
  }));

// Of a real one too little may be seen: the page is given the statuses that a server sends meanwhile.
test('the page shows how far a new camera’s view is', () =>
  withAll(SKY, async (page) => {
    const shown = await page.evaluate(() => {
      const bar = document.getElementById('camera-progress');
      const { app } = window.relight;
      const { status } = app;
      const shows = (preparing) => {
        app.status = { ...status, preparing };
        window.relight.controls.showCamera();
        return bar.hidden ? null : bar.value;
      };
      const all = [shows({ camera: 'gallery', share: 0.25 }), shows({ camera: 'gallery', share: 0.75 }), shows(null)];
      app.status = status;
      return all;
    });
    assert.deepEqual(shown, [0.25, 0.75, null]);
  }));

onOnePage('one page under a sequence of files', () => ['--rate', '10', ...files()], {
  async 'nothing overflows and everything is reachable at any width'(page) {
    for (const [width, height] of [[320, 640], [390, 844], [844, 390], [910, 700], [1000, 800], [1920, 1080]]) {
      await page.setViewportSize({ width, height });
      await page.evaluate(() => { window.scrollTo(0, 0); document.querySelector('#panels').scrollTo(0, 0); });
      await untilFrames(page, 1);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= document.documentElement.clientWidth), `${width} wide`);
      const out = await page.evaluate(() => [...document.querySelectorAll('button, input, select, output, label')]
        .filter((e) => e.checkVisibility())
        .filter((e) => { const b = e.getBoundingClientRect(); return b.right > innerWidth + 0.5 || b.left < -0.5 || b.width < 16; })
        .map((e) => e.id || e.textContent));
      assert.deepEqual(out, [], `${width} wide`);
      await page.locator('#set-fps').scrollIntoViewIfNeeded();
      const picture = await page.locator('#picture').boundingBox();
      const field = await page.locator('#set-fps').boundingBox();
      assert.ok(picture.y > -1 && picture.y + picture.height <= height + 1, `the picture is out of sight at ${width}`);
      assert.ok(width > height || field.y >= picture.y + picture.height, `the picture hides a control at ${width}`);
    }
    await page.setViewportSize({ width: 1000, height: 800 });
  },

  async 'every control can be reached, seen and operated by keyboard'(page, witness) {
    const reached = [];
    for (let i = 0; i < 60; i++) {
      await page.keyboard.press('Tab');
      const at = await page.evaluate(() => {
        const e = document.activeElement;
        const { outlineStyle, outlineWidth } = getComputedStyle(e);
        const label = e.getAttribute('aria-label') || e.labels?.[0]?.textContent || e.textContent;
        return { id: e.id, tag: e.tagName, label: label?.trim(), ring: outlineStyle !== 'none' && parseFloat(outlineWidth) >= 2 };
      });
      if (at.tag === 'BODY') break;
      assert.ok(at.ring, `no ring on ${at.id || at.label}`);
      assert.ok(at.label, `no label on ${at.id}`);
      reached.push(at.id);
    }
    const all = await page.$$eval('button, input, select', (es) => es.filter((e) => e.checkVisibility() && !e.disabled).map((e) => e.id));
    assert.deepEqual(all.filter((id) => id && !reached.includes(id)), []);
    for (const id of ['play', 'scrub', 'set-camera', 'set-rotate', 'exposure-mode', 'set-exposure', 'set-tone', 'set-paths', 'set-method',
      'set-effort', 'set-fps']) assert.ok(reached.includes(id), id);
    // in page order: timeline, then the panel
    assert.ok(reached.indexOf('play') < reached.indexOf('scrub') && reached.indexOf('scrub') < reached.indexOf('set-camera'));
    await page.focus('#play');
    await page.keyboard.press('Space'); // once, though Space is also a page-wide key
    await inForce(witness, { paused: true });
    const at = async (position) => { // also for the page, whose slider follows its status
      await witness.until((want) => window.said.status.source.position === want, position);
      await page.waitForFunction((want) => window.relight.status.source.position === want, position);
    };
    await page.focus('#scrub');
    await page.keyboard.press('Home');
    await at(0);
    await page.keyboard.press('ArrowRight'); // the slider's own, not the page's
    await at(1);
    await page.focus('#step-on');
    await page.keyboard.press('Space'); // the button's own
    await at(2);
    assert.equal((await witness.control()).paused, true);
    await page.focus('#set-rotate');
    await page.keyboard.press('ArrowRight');
    await inForce(witness, { rotate_degrees: 1 });
    await page.focus('#exposure-mode');
    await page.keyboard.press('a'); // the list's own
    await inForce(witness, { exposure_stops: 'auto' });
    assert.equal((await witness.control()).paused, true);
  },

  async 'files play, pause, step and can be scrubbed'(page, witness) {
    await witness.say({ op: 'control', request: 1, paused: false });
    await inForce(witness, { paused: false });
    await page.waitForFunction(() => document.getElementById('play').title !== 'Resume the sky');
    await page.click('#play');
    await inForce(witness, { paused: true });
    await witness.until(() => window.said.status.source.state === 'paused');
    await setRange(page, 'scrub', 7);
    await witness.until(() => window.said.status.source.position === 7 && window.said.status.frame === 107);
    await page.waitForFunction(() => document.getElementById('scrub-text').textContent === '8 of 20');
    await page.click('#step-on');
    await witness.until(() => window.said.status.source.position === 8);
    await page.click('#step-back');
    await page.click('#step-back');
    await witness.until(() => window.said.status.source.position === 6);
    assert.equal((await witness.status()).source.state, 'paused');
    assert.equal(await page.getAttribute('#play', 'aria-label'), 'Resume the sky');
    await page.click('#play');
    await inForce(witness, { paused: false });
    await witness.until(() => window.said.status.source.position > 8);
    // a dragged slider requests only the newest position, and ends where it was released
    await page.click('#play');
    await inForce(witness, { paused: true });
    for (let i = 0; i < 20; i++) await setRange(page, 'scrub', (i * 7) % 20);
    await setRange(page, 'scrub', 11);
    await witness.until(() => window.said.status.source.position === 11);
  },
});

test('keys do the same, on a computed sky by the hour', () =>
  withAll(['--camera', 'gallery', '--paths', 'all', ...MINUTES], async (page, witness) => {
    const press = (key) => page.keyboard.press(key);
    await press('Space');
    await inForce(witness, { paused: true });
    await witness.until(() => window.said.status.source.state === 'paused');
    const hour = (h) => witness.until((want) => Math.abs(window.said.status.source.hour - want) < 1e-3, h);
    await setRange(page, 'scrub', 12); // from a known position: one more frame may be under way
    await hour(12);
    await press('ArrowRight');
    await hour(12 + 1 / 60);
    await press('ArrowLeft');
    await press('ArrowLeft');
    await hour(12 - 1 / 60);
    await page.waitForFunction(() => Math.abs(window.relight.status.source.hour - 12 + 1 / 60) < 1e-3);
    await press('Shift+ArrowRight');
    await hour(13 - 1 / 60);
    for (let i = 0; i < 3; i++) await press(']');
    await inForce(witness, { rotate_degrees: 15 });
    await press('[');
    await inForce(witness, { rotate_degrees: 10 });
    await press('+');
    await press('+');
    await press('-');
    await inForce(witness, { bias_stops: 0.5 });
    await press('a');
    await witness.until(() => window.said.control.exposure_stops !== null);
    await press('a');
    await inForce(witness, { exposure_stops: null });
    await press('t');
    await inForce(witness, { tone: 'reinhard' });
    await press('l');
    await inForce(witness, { paths: 'direct' });
    await press('l');
    await press('c');
    await inForce(witness, { camera: 'main', paths: 'all' });
    await press('m');
    await inForce(witness, { method: 'uniform' });
    for (let i = 0; i < 5; i++) await press('m');
    await inForce(witness, { method: 'mis' });
    await press('g');
    await inForce(witness, { samples: 8 });
    await press('Shift+G');
    await inForce(witness, { samples: 4 });
    await press('r');
    await inForce(witness, { fps: 15 });
    await untilToast(page, /^Frame rate limit: 15$/);
    await press('Space');
    await inForce(witness, { paused: false });
  }));

// Fingers as Chromium's own input has them: points of {x, y}; none lifts all.
async function touchScreen(page) {
  const session = await page.context().newCDPSession(page);
  return (type, points) => session.send('Input.dispatchTouchEvent', { type, touchPoints: points.map((p, id) => ({ ...p, id })) });
}

test('two fingers turn the camera and pinch it nearer; one rotates the sky', () =>
  withAll(SKY, async (page, witness) => {
    const box = await page.locator('#picture').boundingBox();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    const touch = await touchScreen(page);
    const shown = (view) => page.waitForFunction((v) => window.relight.app.control.camera === v, view);
    const parts = (view) => view.slice(1).split(';').map((p) => p.split(',').map(Number));
    const far = ([from, to]) => Math.hypot(...from.map((v, i) => v - to[i]));
    await page.waitForFunction(() => window.relight.status?.view?.startsWith('@'));
    const before = parts((await witness.status()).view);
    const pair = (dx, half) => [{ x: x - half + dx, y }, { x: x + half + dx, y }];
    await touch('touchStart', pair(0, 40));
    for (let i = 1; i <= 4; i++) await touch('touchMove', pair((i * box.width) / 32, 40));
    await page.waitForFunction(() => window.relight.app.control.camera?.startsWith('@'));
    for (let i = 1; i <= 4; i++) await touch('touchMove', pair(box.width / 8, 40 + 10 * i));
    await touch('touchEnd', []);
    await page.waitForFunction((d) => {
      const [from, to] = window.relight.app.control.camera.slice(1).split(';').map((p) => p.split(',').map(Number));
      return Math.abs(Math.hypot(...from.map((v, i) => v - to[i])) - d) < 0.02 * d; // twice as far apart: half as far away
    }, far(before) / 2);
    const { camera, rotate_degrees: turned } = await witness.control();
    await shown(camera);
    const angle = ([[px, , pz], [cx, , cz]]) => Math.atan2(px - cx, pz - cz);
    const by = angle(before) - angle(parts(camera));
    assert.ok(Math.abs(Math.abs(Math.atan2(Math.sin(by), Math.cos(by))) - Math.PI / 8) < 0.02, `turned by ${by}`);
    assert.equal(turned, 0);
    await touch('touchStart', [{ x, y }]);
    await touch('touchMove', [{ x: x + 30, y }]);
    await touch('touchMove', [{ x: x + 60, y }]);
    await touch('touchEnd', []);
    await witness.until(() => window.said.control.rotate_degrees !== 0);
    assert.equal((await witness.control()).camera, camera);
  }, { hasTouch: true }));

test('a viewer sees current settings, and why they cannot be changed', () =>
  withAll(SKY, async (page, witness) => {
    assert.equal(await page.textContent('#role'), 'Watching');
    assert.match(await page.textContent('#controls-why'), /^You are watching\. .*#role=controller/);
    for (const id of ['play', 'step-on', 'scrub', 'set-camera', 'set-rotate', 'exposure-mode', 'set-tone', 'set-fps'])
      assert.ok(await page.isDisabled(`#${id}`), id);
    await page.keyboard.press('Space');
    await page.keyboard.press('t');
    await untilToast(page, /Only a controller/);
    await witness.say({ op: 'control', request: 1, tone: 'linear' });
    await page.waitForFunction(() => document.getElementById('set-tone').value === 'linear');
    assert.equal((await witness.control()).paused, false);
  }, { hash: '#role=viewer' }));

test('a token in the address grants control, without it the page watches', async () => {
  const server = await startServer(RELIGHTD, [...CHEAP, '--token-controller', 'se cret', ...SKY]);
  try {
    for (const [hash, role] of [['', 'Watching'], ['#token=wrong', 'Watching'], ['#token=se%20cret', 'Controlling']]) {
      const page = await openPage(chromium.browser, server.url + hash);
      await page.waitForFunction(() => window.relight?.frames > 0 && window.relight.app.control);
      assert.equal(await page.textContent('#role'), role, `with "${hash}"`);
      await page.close();
    }
  } finally {
    await server.stop();
  }
});

test('controls work again after a server restart', () =>
  withAll(SKY, async (page, witness, server) => {
    await page.selectOption('#set-tone', 'linear');
    await inForce(witness, { tone: 'linear' });
    await server.stop();
    await page.waitForFunction(() => window.relight.state.name === 'reconnecting');
    assert.match(await page.textContent('#controls-why'), /Not connected/);
    assert.ok(await page.isDisabled('#set-tone'));
    const again = await startServer(RELIGHTD, [...CHEAP, '--port', server.port, ...SKY]);
    try {
      await page.waitForFunction(() => window.relight.state.name === 'live');
      await page.waitForFunction(() => document.getElementById('set-tone').value === 'filmic'); // the new session's
      await page.selectOption('#set-tone', 'reinhard');
      await page.waitForFunction(() => window.relight.app.control.tone === 'reinhard');
    } finally {
      await again.stop();
    }
  }));

// Relative luminance and contrast as in WCAG 2: 4.5 for text, 3 for edges of interactive elements and the focus ring.
test('contrast suffices in both themes, controlling and watching', async () => {
  for (const hash of ['', '#role=viewer']) {
    await withAll(SKY, async (page) => {
      await page.keyboard.press('?');
      for (const theme of ['dark', 'light']) {
        await page.evaluate((t) => { document.documentElement.dataset.theme = t; }, theme);
        const poor = await page.evaluate(() => {
          const parse = (text) => {
            const [r, g, b, a = 1] = text.match(/[\d.]+/g).map(Number);
            return [r, g, b, a];
          };
          const over = (top, below) => [0, 1, 2].map((i) => top[i] * top[3] + below[i] * (1 - top[3]));
          const ground = (e) => {
            if (!e) return [255, 255, 255];
            const colour = parse(getComputedStyle(e).backgroundColor);
            return colour[3] === 1 ? colour.slice(0, 3) : over(colour, ground(e.parentElement));
          };
          const light = (rgb) => rgb.map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
            .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
          const contrast = (a, b) => (Math.max(light(a), light(b)) + 0.05) / (Math.min(light(a), light(b)) + 0.05);
          const found = [];
          let texts = 0;
          for (const e of document.querySelectorAll('body *')) {
            if (!e.checkVisibility() || e.closest('#veil, option, svg')) continue;
            const name = `${e.tagName} ${e.id} "${e.textContent.trim().slice(0, 20)}"`;
            const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()) || e.tagName === 'SELECT';
            const style = getComputedStyle(e);
            texts += own;
            if (own && contrast(over(parse(style.color), ground(e)), ground(e)) < 4.5) found.push(`text ${name}`);
            const operated = e.matches('button, select, kbd');
            if (operated && contrast(over(parse(style.borderTopColor), ground(e.parentElement)), ground(e.parentElement)) < 3)
              found.push(`edge ${name}`);
          }
          const root = getComputedStyle(document.documentElement);
          const paint = document.createElement('canvas').getContext('2d');
          const variable = (v) => {
            paint.fillStyle = root.getPropertyValue(v).trim();
            paint.fillRect(0, 0, 1, 1);
            return [...paint.getImageData(0, 0, 1, 1).data].slice(0, 3);
          };
          for (const on of ['--ground', '--raised'])
            for (const mark of ['--sun', '--sky', '--good', '--bad', '--edge', '--violet', '--grey'])
              if (contrast(variable(mark), variable(on)) < 3) found.push(`${mark} on ${on}`);
          return { found, texts };
        });
        assert.ok(poor.texts > 60, `${poor.texts} texts were looked at`);
        assert.deepEqual(poor.found, [], theme);
      }
    }, { hash });
  }
});
