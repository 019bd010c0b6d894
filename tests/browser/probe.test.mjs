// The pixel probe in Chromium with the whole program: what it shows against relight-render's output for the same
// scene, sky and seed. RELIGHT_BIN is the folder of both programs.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { after, before, test } from 'node:test';
import { beginTests, openPage, startServer, untilFrames, untilState } from './lib.mjs';

const chromium = await beginTests(['RELIGHT_BIN']);
const BIN = chromium.RELIGHT_BIN;

const WIDTH = 320;
const HEIGHT = 180;
const WAY = ['--size', `${WIDTH}x${HEIGHT}`, '--samples', '40', '--method', 'mis', '--paths', 'direct'];
const STILL = ['--source', 'sky:size=256x128,hour=9', '--frames', '2-2'];
const FLOOR = [150, 150]; // pixels of the built-in court
const SKY = [40, 12];

let server;
before(async () => {
  server = await startServer(`${BIN}/relightd`, ['--port', '0', ...STILL, '--once', '--converge', 'off', ...WAY]);
});
after(async () => {
  await server?.stop();
});

// The page's default request: 64 samples.
function rendered([x, y], ...more) {
  const how = more.length ? more : ['--probe-samples', '64'];
  return JSON.parse(execFileSync(`${BIN}/relight-render`, [...STILL, ...WAY, '--probe', `${x},${y}`, ...how]));
}

async function withPage(body, { at = server, options = {} } = {}) {
  const page = await openPage(chromium.browser, at.url, options);
  try {
    await page.waitForFunction(() => window.relight.frames > 0 && window.relight.status?.width > 0);
    await body(page);
    assert.deepEqual(page.faults, []);
  } finally {
    await page.close();
  }
}

// A pixel's position on the page: the image is centred in its canvas, as large as fits.
function placeOf(page, [x, y]) {
  return page.evaluate(([px, py, width, height]) => {
    const box = document.getElementById('picture').getBoundingClientRect();
    const scale = Math.min(box.width / width, box.height / height);
    return [box.left + box.width / 2 + scale * (px + 0.5 - width / 2), box.top + box.height / 2 + scale * (py + 0.5 - height / 2)];
  }, [x, y, WIDTH, HEIGHT]);
}

function untilAnswer(page, [x, y], preset = null) {
  return page.waitForFunction(([px, py, p]) => {
    const { answer, shown } = window.relight.probe;
    return answer?.x === px && answer?.y === py && answer?.preset === p && !shown.hidden;
  }, [x, y, preset]);
}

async function click(page, pixel) {
  // The first image sets the canvas size; positions computed before it are wrong.
  await page.waitForFunction(([w, h]) => {
    const { width, height } = document.getElementById('picture');
    return width === w && height === h;
  }, [WIDTH, HEIGHT]);
  await page.mouse.click(...await placeOf(page, pixel));
  await untilAnswer(page, pixel);
}

const answerOf = (page) => page.evaluate(() => window.relight.probe.answer);
const tableOf = (page) => page.evaluate(() => Object.fromEntries([...document.querySelectorAll('#probe-table tr')].map((row) =>
  [row.querySelector('th').textContent, row.querySelector('td').firstChild.textContent])));
const numbers = (text) => text.replaceAll('−', '-').match(/-?\d+(\.\d+)?(e[-+]\d+)?/g).map(Number);
const like = (shown, wanted, what) => shown.forEach((v, i) =>
  assert.ok(Math.abs(v - wanted[i]) <= 0.006 * Math.abs(wanted[i]) + 1e-9, `${what}: ${v} is shown, ${wanted[i]} is meant`));

test('a click shows relight-render’s answer for that pixel', () => withPage(async (page) => {
  await click(page, FLOOR);
  const want = rendered(FLOOR);
  assert.deepEqual(await answerOf(page), want);
  const table = await tableOf(page);
  like(numbers(table['Radiance in the image']), want.picture, 'the picture');
  like(numbers(table['From these 64 samples']), want.pixel.radiance, 'the estimate');
  like(numbers(table['Converged']), [0, 1, 2].flatMap((c) => [want.pixel.reference.mean[c], want.pixel.reference.error[c]]), 'the reference');
  numbers(table.Normal).forEach((v, i) => assert.ok(Math.abs(v - want.point.normal[i]) < 6e-4));
  numbers(table.Position).forEach((v, i) => assert.ok(Math.abs(v - want.point.position[i]) < 6e-3));
  assert.ok(table.Material.startsWith(`${want.point.material.name}, ${want.point.material.kind}`));
  const shares = await page.evaluate(() => [...document.querySelectorAll('#probe-shares tbody tr')].map((row) =>
    [...row.children].map((cell) => cell.textContent)));
  assert.deepEqual(shares.map(([face]) => face), ['+X', '-X', '+Y', '-Y', '+Z', '-Z']);
  shares.forEach(([, share, energy, chosen, arrive], i) => {
    const s = want.shares[i];
    assert.ok(Math.abs(numbers(share)[0] - 100 * s.share) <= 0.51, `${share} for ${s.share}`);
    assert.ok(Math.abs(numbers(energy)[0] - 100 * s.energy) <= 0.51);
    assert.deepEqual([...numbers(chosen), ...numbers(arrive)], [s.chosen, s.generated, s.visible]);
  });
  const bars = await page.evaluate(() => [...document.querySelectorAll('.probe-bar')].map((bar) =>
    bar.getBoundingClientRect().width / bar.parentElement.getBoundingClientRect().width));
  bars.forEach((part, i) => assert.ok(Math.abs(part - want.shares[i].share) < 0.02, `bar ${i}: ${part}`));
  const count = (state) => want.light.filter((s) => (s.length < 4 ? -1 : s[3]) === state).length;
  const legend = await page.evaluate(() => [...document.querySelectorAll('#probe-legend li')].map((li) => li.textContent));
  assert.deepEqual(legend.slice(0, 4).map((text) => Number.parseInt(text, 10)), [-1, 0, 1, 2].map(count));
}));

// The drawn position of a direction, by the conventions' own formulas.
const LATLONG = ([x, y, z]) => [0.5 - Math.atan2(x, z) / (2 * Math.PI), Math.acos(y) / Math.PI];
function CROSS([x, y, z]) {
  const a = [Math.abs(x), Math.abs(y), Math.abs(z)];
  const most = Math.max(...a);
  const [px, py, pz] = [x / most, y / most, z / most];
  const on = (column, row, right, up) => [(column + 0.5 + right / 2) / 4, (row + 0.5 - up / 2) / 3];
  if (most === a[0]) return x > 0 ? on(0, 1, pz, py) : on(2, 1, -pz, py);
  if (most === a[1]) return y > 0 ? on(1, 0, -px, -pz) : on(1, 2, -px, pz);
  return z > 0 ? on(1, 1, -px, py) : on(3, 1, px, py);
}

function colourAt(page, id, [u, v]) {
  return page.evaluate(([name, a, b]) => {
    const canvas = document.getElementById(name);
    const at = [Math.floor(a * canvas.width), Math.floor(b * canvas.height)];
    return [...canvas.getContext('2d').getImageData(...at, 1, 1).data].slice(0, 3);
  }, [id, u, v]);
}

test('each sample is drawn in its direction, in the colour of its fate', () => withPage(async (page) => {
  await page.setViewportSize({ width: 1400, height: 1000 });
  await click(page, FLOOR);
  await page.uncheck('#probe-follow');
  await page.uncheck('#probe-visibility');
  const answer = await answerOf(page);
  for (const [id, place, width, height] of [['probe-latlong', LATLONG, 340, 170], ['probe-cross', CROSS, 340, 255]]) {
    let seen = 0;
    const marks = answer.light.map((s) => ({ state: s.length > 3 ? s[3] : -1, at: place(s) }));
    const normal = place(answer.point.normal);
    const apart = (a, b) => Math.hypot((a[0] - b[0]) * width, (a[1] - b[1]) * height);
    for (const m of marks) {
      const alone = marks.every((o) => o === m || apart(o.at, m.at) > 9) && apart(normal, m.at) > 9;
      if (!alone || (m.state !== -1 && m.state !== 2)) continue;
      const [r, g, b] = await colourAt(page, id, m.at);
      if (m.state === 2) assert.ok(g > r + 60 && g > b + 40, `${id}: an effective one at ${m.at} is ${[r, g, b]}`);
      else assert.ok(r > g + 40 && r > b + 40, `${id}: a generated one at ${m.at} is ${[r, g, b]}`);
      seen++;
    }
    assert.ok(seen >= 20, `${seen} lie apart`);
    const [r, g, b] = await colourAt(page, id, normal);
    assert.ok(g > r + 80 && b > r + 80, `${id}: the normal is ${[r, g, b]}`);
  }
}));

test('hidden directions are darkened, and BRDF samples appear', () => withPage(async (page) => {
  await click(page, FLOOR);
  await page.uncheck('#probe-follow');
  const sum = () => page.evaluate(() => {
    const canvas = document.getElementById('probe-latlong');
    return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.reduce((a, v) => a + v, 0);
  });
  const dark = await sum();
  await page.uncheck('#probe-visibility');
  assert.ok(await sum() > 1.1 * dark);
  await page.check('#probe-lobes');
  const { lobes } = await answerOf(page);
  const legend = await page.textContent('#probe-legend');
  assert.ok(lobes.length === 32 && legend.includes('32 BRDF samples'), legend);
}));

test('the keyboard alone chooses a pixel, and Tab reaches every control', () => withPage(async (page) => {
  await page.keyboard.press('p');
  const start = await page.evaluate(() => document.activeElement.id);
  assert.equal(start, 'probe-hair');
  const half = [WIDTH / 2, HEIGHT / 2];
  await page.keyboard.press('ArrowLeft');
  await page.keyboard.press('Shift+ArrowDown');
  await page.keyboard.press('Shift+ArrowDown');
  await page.keyboard.press('ArrowUp');
  assert.equal(await page.textContent('#probe-hair span'), `pixel ${half[0] - 1}, ${half[1] + 19}`);
  await page.keyboard.press('Enter');
  await untilAnswer(page, [half[0] - 1, half[1] + 19]);
  const wanted = ['probe-preset', 'probe-samples', 'probe-visibility', 'probe-lobes', 'probe-follow', 'probe-save', 'probe-stop'];
  const reached = new Set();
  for (let i = 0; i < 60 && reached.size < wanted.length; i++) {
    await page.keyboard.press('Tab');
    const id = await page.evaluate(() => document.activeElement.id);
    if (wanted.includes(id)) reached.add(id);
  }
  assert.deepEqual([...reached].sort(), [...wanted].sort());
  await page.keyboard.press('Enter'); // on the last of them: stops the probe
  assert.ok(!(await page.isVisible('#probe-shown')));
}));

test('a sky pixel has no samples, and says so', () => withPage(async (page) => {
  await click(page, SKY);
  const want = rendered(SKY);
  assert.deepEqual(await answerOf(page), want);
  assert.equal(want.sees, 'sky');
  assert.match(await page.textContent('#probe-words'), /shows the sky\. It sees the sky directly/);
  assert.match(await page.textContent('.probe-spoken'), /shows the sky/);
  assert.ok(!(await page.isVisible('#probe-shares')));
  like(numbers((await tableOf(page))['Radiance in the image']), want.picture, 'the picture');
}));

test('the preset is the figure: 50 samples and an exponent of 150', () => withPage(async (page) => {
  await click(page, FLOOR);
  await page.click('#probe-preset');
  await untilAnswer(page, FLOOR, 'fig1');
  assert.deepEqual(await answerOf(page), rendered(FLOOR, '--probe-preset', 'fig1'));
  assert.equal(await page.getAttribute('#probe-preset', 'aria-pressed'), 'true');
  const table = await page.textContent('#probe-table');
  assert.match(table, /exponent 150/);
  assert.match(table, /50 samples/);
  assert.ok(await page.isDisabled('#probe-samples'));
  await page.click('#probe-preset');
  await untilAnswer(page, FLOOR);
  await page.selectOption('#probe-samples', '256');
  await page.waitForFunction(() => window.relight.probe.answer.samples === 256);
  assert.deepEqual(await answerOf(page), rendered(FLOOR, '--probe-samples', '256'));
  await page.selectOption('#probe-samples', ''); // as in the image
  await page.waitForFunction(() => window.relight.probe.answer.samples === 40);
}));

test('a busy server is asked again, an older one is not', () => withPage(async (page) => {
  await click(page, FLOOR);
  await page.uncheck('#probe-follow');
  await page.waitForFunction(() => !window.relight.probe.waiting);
  const refuse = (error) => page.evaluate((e) => {
    const { probe } = window.relight;
    probe.answer = null;
    probe.waiting = 4711; // simulates a pending request
    probe.askedMs = performance.now();
    probe.takeError({ ...e, request: e.clause === '3.4' ? undefined : 4711 });
    return probe.words.textContent;
  }, error);
  assert.match(await refuse({ code: 'busy', clause: '4.15.6', message: 'too many ask at once' }), /busy/);
  await untilAnswer(page, FLOOR); // without another request by us
  assert.match(await refuse({ code: 'not_offered', clause: '4.15.7', message: 'there is no image yet' }), /there is no image yet/);
  assert.match(await refuse({ code: 'unknown_op', clause: '3.4', message: 'op "probe" is not known' }), /does not support the pixel probe/);
  assert.ok(!(await page.isVisible('#probe-shown')));
}));

test('the answer can be saved', () => withPage(async (page) => {
  await click(page, FLOOR);
  const [download] = await Promise.all([page.waitForEvent('download'), page.click('#probe-save')]);
  assert.equal(download.suggestedFilename(), `probe_${FLOOR[0]}_${FLOOR[1]}_frame_2.json`);
  const { over_time: trace, ...saved } = JSON.parse(readFileSync(await download.path(), 'utf8'));
  assert.deepEqual(saved, rendered(FLOOR));
  assert.ok(Array.isArray(trace));
}));

test('on a phone a tap chooses, and nothing is wider than the window', () => withPage(async (page) => {
  const [x, y] = await placeOf(page, FLOOR);
  await page.evaluate(([cx, cy]) => { // a finger: touch pointer events, then the click that follows a tap
    const target = document.elementFromPoint(cx, cy);
    for (const type of ['pointerdown', 'pointerup'])
      target.dispatchEvent(new PointerEvent(type, { bubbles: true, pointerType: 'touch', clientX: cx, clientY: cy }));
    target.dispatchEvent(new MouseEvent('click', { bubbles: true, clientX: cx, clientY: cy }));
  }, [x, y]);
  await untilAnswer(page, FLOOR);
  const top = await page.evaluate(() => document.getElementById('probe-title').getBoundingClientRect().top);
  const under = await page.evaluate(() => document.getElementById('stage').getBoundingClientRect().bottom);
  assert.ok(top >= under - 1 && top < 744, `the panel begins at ${top}, the picture ends at ${under}`);
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  assert.ok(wide <= 0, `${wide} px wider`);
}, { options: { width: 390, height: 844 } }));

test('a followed pixel is plotted as the sky moves, and its samples move too', async () => {
  const moving = await startServer(`${BIN}/relightd`, ['--port', '0', '--source', 'sky:size=256x128,hour=9,speed=7', '--rate', '8', ...WAY, '--samples', '4']);
  try {
    await withPage(async (page) => {
      await untilState(page, 'live');
      await click(page, FLOOR);
      const first = await answerOf(page);
      await page.waitForFunction(({ frame, light }) => window.relight.probe.trace.points.length >= 5 && window.relight.probe.answer.frame > frame
        && JSON.stringify(window.relight.probe.answer.light) !== JSON.stringify(light), first);
      const { points, answer } = await page.evaluate(() => {
        const { trace, answer: now } = window.relight.probe;
        return { points: trace.points, answer: now };
      });
      const same = points.find((p) => p.frame === answer.frame);
      if (same) like(same.rgb, answer.picture, 'the plotted value');
      assert.match(await page.textContent('#probe-plot-words'), /Over \d+ s the luminance went from|grows with each image/);
      const drawn = await page.evaluate(() => {
        const canvas = document.getElementById('probe-plot');
        return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some((v) => v > 0);
      });
      assert.ok(drawn);
      await page.uncheck('#probe-follow');
      await untilFrames(page, 3); // everything under way has arrived
      const last = () => page.evaluate(() => window.relight.probe.trace.points.at(-1).frame);
      const end = await last();
      await untilFrames(page, 6);
      assert.equal(await last(), end);
    }, { at: moving });
  } finally {
    await moving.stop();
  }
});
