// The speed and accuracy panel and the sky panel in Chromium with the whole program: what they show against headers
// and statuses. RELIGHT_RELIGHTD names the server program.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { latencyParts } from '../../clients/web/insight_model.js';
import { FLAG_FINER } from '../../clients/js/protocol.js';
import { milliseconds } from '../../clients/web/sentences.js';
import { beginTests, openPage, startServer, until } from './lib.mjs';

const chromium = await beginTests(['RELIGHT_RELIGHTD']);
const RELIGHTD = chromium.RELIGHT_RELIGHTD;

// Without a cache, whose images come with no error.
async function withPage(args, body, options) {
  const server = await startServer(RELIGHTD, ['--port', '0', '--size', '64x36', '--allow-bias', '0', '--edge-rays', '1', ...args]);
  const page = await openPage(chromium.browser, `${server.url}?coding=jpeg`, options);
  try {
    await page.waitForFunction(() => window.relight?.frames > 0 && window.relight.status?.frames?.used > 0);
    await body(page, server);
    assert.deepEqual(page.faults, []);
  } finally {
    await page.close();
    await server.stop();
  }
}

// A group of tests on one page, in this order: opening a page costs as much processor time as three seconds of images.
const onOnePage = (title, args, tests) => test(title, (t) => withPage(args, async (page) => {
  await listen(page);
  for (const [name, body] of Object.entries(tests)) await t.test(name, () => body(page));
}));

const say = (page, message) => page.evaluate((m) => window.relight.app.send({ op: 'control', request: 1, ...m }), message);

// All headers and statuses from here on, in order of arrival; and those of which the panel takes the latency, with its times.
const listen = (page) => page.evaluate(() => {
  window.heard = { headers: [], statuses: [], times: [] };
  window.relight.app.on('picture', ({ header }) => window.heard.headers.push(header));
  const { insight } = window.relight.insight;
  const picture = insight.picture.bind(insight);
  insight.picture = (header, nowUs, t) => {
    const before = insight.seconds.reduce((sum, { count }) => sum + count, 0);
    picture(header, nowUs, t);
    if (insight.seconds.reduce((sum, { count }) => sum + count, 0) !== before) window.heard.times.push({ header, nowUs, t });
  };
  window.relight.app.on('status', (s) => window.heard.statuses.push(s));
});

// One thread, and an error that takes less than a frame's time: otherwise auto fills it.
const AUTO = ['--source', 'sky:size=128x64,time=10:00,speed=20', '--fps', '8', '--threads', '1', '--method', 'auto', '--error', '2e-2', '--paths', 'direct'];

onOnePage('the panel under auto', AUTO, {
  async 'each point is a drawn image, with its header’s time and its status’s error'(page) {
    await page.waitForFunction(() => {
      const { heard } = window;
      window.held = window.relight.insight.insight.points.filter((p) =>
        heard.headers.some((h) => h.sequence === p.sequence) && heard.statuses.some((s) => s.frame === p.frame));
      return window.held.length >= 3 && window.held.some((p) => p.error > 0);
    });
    const { held, heard } = await page.evaluate(() => ({ held: window.held, heard: window.heard }));
    for (const p of held) {
      const h = heard.headers.find(({ sequence }) => sequence === p.sequence);
      const s = heard.statuses.find(({ frame }) => frame === p.frame);
      assert.equal(h.frame, p.frame);
      assert.equal(p.shadedMs, h.shadedUs / 1000);
      assert.equal(p.wholeMs, (h.queuedUs + h.decodedUs + h.shadedUs + h.encodedUs) / 1000);
      assert.equal(p.error, s.light.error);
      assert.equal(p.method, s.method);
    }
  },

  // Points are at their axis positions: the method's colour at each point's place on the canvas.
  async 'the newest point is at its time and error, within a ring, and also in the texts'(page) {
    await page.waitForFunction(() => window.relight.insight.insight.points.filter((p) => p.error > 0).length >= 3);
    const got = await page.evaluate(async () => {
      const { scatterPlaces, styleOf } = await import('./insight_draw.js');
      const { colours } = await import('./dom.js');
      const { errorText } = await import('./insight_model.js');
      const panel = window.relight.insight;
      panel.show();
      const canvas = panel.scatter;
      const at = scatterPlaces(panel.insight.points, false, { width: canvas.width, height: canvas.height, unit: devicePixelRatio });
      const { last } = panel.insight;
      const spot = document.createElement('canvas').getContext('2d');
      spot.fillStyle = colours()(styleOf(panel.methods.indexOf(last.method)).colour);
      spot.fillRect(0, 0, 1, 1);
      const [x, y] = [at.x(last.shadedMs), at.y(last.error)];
      const pixel = (dx) => [...canvas.getContext('2d').getImageData(Math.floor(x + dx), Math.floor(y), 1, 1).data.slice(0, 3)];
      return {
        last, error: errorText(last.error), pixel: pixel(0), wanted: [...spot.getImageData(0, 0, 1, 1).data.slice(0, 3)],
        x, y, at: { left: at.left, right: at.right, top: at.top, bottom: at.bottom, xs: at.xs, ys: at.ys },
        table: Object.fromEntries([...document.querySelectorAll('#insight-table tr')].map((r) => [r.cells[0].textContent, r.cells[1].textContent])),
        words: document.getElementById('insight-words').textContent, label: canvas.getAttribute('aria-label'),
        methods: [...document.querySelectorAll('#insight-methods li')].map((li) => li.textContent),
      };
    });
    got.pixel.forEach((v, c) => assert.ok(Math.abs(v - got.wanted[c]) <= 6, `${got.pixel} for ${got.wanted}`));
    const { at, last } = got; // the same place, computed independently
    const across = Math.log10(last.shadedMs / at.xs.least) / Math.log10(at.xs.most / at.xs.least);
    assert.ok(Math.abs(got.x - (at.left + across * (at.right - at.left))) < 0.5);
    const up = Math.log10(last.error / at.ys.least) / Math.log10(at.ys.most / at.ys.least);
    assert.ok(Math.abs(got.y - (at.bottom - up * (at.bottom - at.top))) < 0.5);
    const near = (text, ms) => { // rounded to milliseconds, from a second on to tenths of a second
      const unit = /\d s$/.test(text) ? 1000 : 1;
      assert.ok(Math.abs(Number.parseFloat(text) * unit - ms) <= (unit === 1 ? 0.51 : 51), `${text} for ${ms}`);
    };
    near(got.table.Relight, last.shadedMs);
    near(got.table['Server total'], last.wholeMs);
    assert.equal(got.table['Error (relMSE)'], got.error);
    assert.equal(got.table.Method, 'auto');
    assert.match(got.table['Newest image'], new RegExp(`^frame ${last.frame}\\b`));
    assert.ok(got.label.includes(got.words) && got.words.includes('with auto'));
    assert.ok(got.methods.includes('auto'));
  },

  async 'the choice names the technique of direct light with its samples, and no omission twice'(page) {
    await page.waitForFunction(() => window.relight.insight.insight.points.length >= 4);
    const { paths, leftOut } = await page.evaluate(() => window.relight.insight.insight.last);
    assert.match(paths, /^direct light.*, \d+ samples a point of [a-z]/);
    const phrases = leftOut.split('; ');
    assert.ok(phrases.length >= 2, leftOut);
    assert.equal(new Set(phrases).size, phrases.length, leftOut);
  },

  // The server's values are means in which a new reading weighs a fifth, recomputed here from the headers of the same
  // images.
  async 'the server’s stage times are smoothed over its images'(page) {
    await page.waitForFunction(() => window.heard.headers.length >= 40);
    const count = await page.evaluate(() => window.heard.statuses.length);
    await page.waitForFunction((n) => window.heard.statuses.length >= n + 2, count);
    const { headers, statuses } = await page.evaluate(() => window.heard);
    const last = statuses.findLast((s) => headers.slice(0, -2).some((h) => h.frame === s.frame));
    const end = headers.findIndex((h) => h.frame === last.frame) + 1;
    const seen = (key, more = 0) => headers.slice(0, end + more).map((h) => h[`${key}Us`] / 1000);
    // The times of images that this viewer skipped, as a busy machine makes it do, are unknown.
    const whole = last.skipped === statuses[0].skipped;
    for (const key of ['queued', 'decoded', 'shaded']) {
      // The next images may have been lit, but not sent, when the status was written: their times are in the means.
      const wanted = [0, 1, 2].map((more) => seen(key, more).reduce((old, ms) => (old > 0 ? old + 0.2 * (ms - old) : ms), 0));
      const told = last.stages_ms[key];
      const slack = 0.02 * Math.max(...seen(key, 2)) + 0.05; // images before the page connected count 0.8^30
      assert.ok(told >= 0, `${key}: ${told}`);
      if (whole) assert.ok(wanted.some((w) => Math.abs(told - w) <= slack), `${key}: ${told} for ${wanted}`);
    }
    const encoded = seen('encoded');
    assert.ok(last.stages_ms.encoded > 0, `${last.stages_ms.encoded}`);
    if (whole) assert.ok(last.stages_ms.encoded <= Math.max(...encoded) + 0.1, `${last.stages_ms.encoded} of ${encoded}`);
  },

  async 'the stages of latency are the means of the headers of a second'(page) {
    await page.waitForFunction(() => {
      const { seconds } = window.relight.insight.insight;
      window.whole = seconds.filter((s) => s.t > window.heard.times[0].t && s !== seconds.at(-1));
      return window.whole.length >= 2;
    });
    const { whole, heard } = await page.evaluate(() => ({ whole: window.whole, heard: window.heard.times }));
    for (const s of whole) {
      const those = heard.filter(({ t }) => t >= s.t && t < s.t + 1000);
      assert.equal(those.length, s.count);
      const mean = (f) => those.reduce((a, h) => a + f(h), 0) / those.length / 1000;
      const wanted = [
        mean(({ header: h }) => h.queuedUs + (h.captureUs > 0 ? Math.max(0, h.publishedUs - h.captureUs - h.queuedUs - h.decodedUs - h.shadedUs - h.encodedUs) : 0)),
        mean(({ header }) => header.decodedUs), mean(({ header }) => header.shadedUs), mean(({ header }) => header.encodedUs),
        mean(({ header, nowUs }) => Math.max(0, nowUs - header.publishedUs))];
      s.sums.forEach((sum, i) => assert.ok(Math.abs(sum / s.count - wanted[i]) < 1e-3, `part ${i}: ${sum / s.count} for ${wanted[i]}`));
    }
    const drawn = await page.evaluate(() => {
      const { latency } = window.relight.insight;
      window.relight.insight.show();
      const seen = new Set();
      const { data } = latency.getContext('2d').getImageData(0, 0, latency.width, latency.height);
      for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255) seen.add(`${data[i]},${data[i + 1]},${data[i + 2]}`);
      const spot = document.createElement('canvas').getContext('2d');
      spot.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--sun').trim();
      spot.fillRect(0, 0, 1, 1);
      return seen.has([...spot.getImageData(0, 0, 1, 1).data.slice(0, 3)].join(','));
    });
    assert.ok(drawn, 'relighting has its colour in the drawing');
  },

  async 'a moving sky is requested at most once a second, a folded panel requests nothing'(page) {
    const frame = await page.evaluate(() => {
      window.asked = []; // each request, with the ticks of a second since the one before
      window.ticks = 0;
      const { sky, app } = window.relight;
      const [ask, send] = [sky.ask.bind(sky), app.send];
      sky.ask = () => { window.ticks++; ask(); };
      app.send = (m) => {
        if (m.op === 'probe') window.asked.push(window.ticks);
        if (m.op === 'probe') window.ticks = 0;
        send(m);
      };
      return sky.sky?.frame ?? 0;
    });
    await page.waitForFunction((f) => window.asked.length >= 3 && window.relight.sky.sky?.frame > f, frame);
    const asked = await page.evaluate(() => window.asked);
    assert.ok(asked.every((ticks) => ticks >= 1), `after so many seconds each: ${asked}`);
    await page.click('#sky-panel summary');
    const open = await page.evaluate(() => { window.ticks = 0; return window.asked.length; });
    await page.waitForFunction(() => window.ticks >= 3);
    assert.equal(await page.evaluate(() => window.asked.length), open);
  },

  async 'a change of method starts a new choice, with the server’s text of what was left out'(page) {
    await page.waitForFunction(() => window.relight.insight.insight.points.length > 0);
    await say(page, { method: 'mis', samples: 4 });
    await page.waitForFunction(() => window.relight.insight.insight.last.method === 'mis');
    await page.evaluate(() => window.relight.insight.show());
    const { choices, light, methods } = await page.evaluate(() => ({
      choices: [...document.querySelectorAll('#insight-choices li')].map((li) => li.textContent), light: window.relight.status.light,
      methods: [...document.querySelectorAll('#insight-methods li')].map((li) => li.textContent),
    }));
    assert.match(choices[0], /^\d+, \d+ (s|min) ago: mis: direct light/);
    assert.ok(choices[0].includes(`Left out: ${light.left_out}`), `${choices[0]} for ${light.left_out}`);
    assert.deepEqual([...methods].sort(), ['auto', 'mis']);
    // Four samples at this size state an error, an upper bound, or neither: the words of the newest image say which.
    await page.waitForFunction(() => {
      const { error, atMost } = window.relight.insight.insight.last;
      const words = document.querySelector('#insight-words').textContent;
      return words.includes('with mis') && words.includes(error ? 'noise about' : atMost ? 'noise at most' : 'its error is not known');
    });
  },

  async 'the statistics include the time before the server had the sky, like latency'(page) {
    await page.waitForFunction(() => window.heard.headers.length >= 40);
    await say(page, { paused: true });
    await page.waitForFunction(() => window.relight.state.name === 'paused');
    await until(async () => { // everything under way has arrived, and the statistics are updated
      const { headers, shown } = await page.evaluate(() => ({
        headers: window.heard.headers, shown: document.getElementById('ms-queued').textContent,
      }));
      const waits = headers.filter((h) => !(h.flags & FLAG_FINER)).slice(-30)
        .map((h) => latencyParts(h, NaN)[0]).sort((a, b) => a - b);
      return shown === milliseconds((waits[14] + waits[15]) / 2);
    });
  },
});

test('for a still sky the error falls with each pass', () =>
  withPage(['--source', 'sky:size=256x128,hour=15', '--frames', '2-2', '--once', '--method', 'auto', '--paths', 'direct'], async (page) => {
    await page.evaluate(() => {
      window.told = [];
      window.relight.app.on('status', ({ light }) => { if (light.passes > 0) window.told.push([light.passes, light.error]); });
    });
    await page.waitForFunction(() => window.told.length >= 2 && window.told.at(-1)[0] >= 4 * window.told[0][0]);
    const told = await page.evaluate(() => window.told);
    const [[few, before], [many, now]] = [told[0], told.at(-1)];
    assert.ok(now > 0 && now < before, `${before} by ${few} passes, ${now} by ${many}`);
  }));

// ---- the sky

// The brightest place of the sky's image, in its texels: the centre of those almost as bright.
const brightest = (page) => page.evaluate(() => {
  const { width, height, data } = window.relight.sky.sky.image;
  const light = (i) => 0.2126 * data[4 * i] + 0.7152 * data[4 * i + 1] + 0.0722 * data[4 * i + 2];
  let most = 0;
  for (let i = 0; i < width * height; i++) most = Math.max(most, light(i));
  let [x, y, n] = [0, 0, 0];
  for (let i = 0; i < width * height; i++)
    if (light(i) > most - 6) [x, y, n] = [x + (i % width) + 0.5, y + Math.floor(i / width) + 0.5, n + 1];
  return { u: x / n / width, v: y / n / height, most };
});
const sunPlace = (page) => page.evaluate(async () => {
  const { toLatLong } = await import('./probe_geometry.js');
  return toLatLong(window.relight.sky.sun);
});
const STILL = ['--source', 'sky:size=256x128,hour=15', '--frames', '2-2', '--converge', 'off', '--method', 'mis', '--samples', '4', '--once'];

onOnePage('the sky panel', STILL, {
  async 'the sky panel shows the frame’s sky and marks its sun, also rotated'(page) {
    for (const turn of [0, 70, -110]) {
      await say(page, { rotate_degrees: turn });
      await page.waitForFunction((t) => window.relight.sky.sky?.turn === t, turn);
      const [sun, bright] = [await sunPlace(page), await brightest(page)];
      const across = Math.abs(((sun.u - bright.u + 1.5) % 1) - 0.5) * Math.sin(Math.PI * sun.v);
      assert.ok(across < 0.03 && Math.abs(sun.v - bright.v) < 0.03, `turned by ${turn}: ${JSON.stringify([sun, bright])}`);
      const { frame, status } = await page.evaluate(() => ({ frame: window.relight.sky.sky.frame, status: window.relight.status }));
      assert.equal(frame, status.frame);
      assert.match(await page.textContent('#sky-words'), new RegExp(`Frame ${frame}.*sun ${Math.round(status.light.sun.elevation)}° high`));
    }
  },

  async 'a probed pixel’s samples are in the sky panel until the probe stops'(page) {
    await page.waitForFunction(() => window.relight.sky.sky);
    const plain = await page.evaluate(() => window.relight.sky.canvas.toDataURL());
    const box = await page.locator('#picture').boundingBox();
    await page.mouse.click(box.x + 0.45 * box.width, box.y + 0.7 * box.height);
    await page.waitForFunction(() => window.relight.sky.pixel?.light.length > 0 && /light samples of pixel/.test(document.getElementById('sky-words').textContent));
    const { pixel, words, marked } = await page.evaluate(() => ({
      pixel: window.relight.probe.answer, words: document.getElementById('sky-words').textContent, marked: window.relight.sky.canvas.toDataURL(),
    }));
    assert.ok(words.includes(`the ${pixel.light.length} light samples of pixel ${pixel.x}, ${pixel.y}`), words);
    assert.notEqual(marked, plain);
    await page.click('#probe-stop');
    await page.waitForFunction(() => !/light samples/.test(document.getElementById('sky-words').textContent));
  },
});

// Under a sky that turns slowly; the switch works both ways, and nothing is fetched while it is off.
test('changed pixels lie over the image while they are asked for', () => withPage(['--source', 'sky:size=64x32,speed=600', '--fps', '4', '--method', 'mis', '--samples', '4', '--paths', 'direct'], async (page) => {
  await page.evaluate(() => { document.querySelector('#insight details').open = true; });
  assert.equal(await page.evaluate(() => window.relight.changes.socket ?? null), null);
  await page.click('#changes-shown');
  await page.waitForFunction(() => /of the pixels changed/.test(document.getElementById('changes-words').textContent));
  const map = await page.evaluate(() => {
    const canvas = document.getElementById('changes-map');
    const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    let red = 0;
    for (let i = 0; i < data.length; i += 4) red += data[i + 3] > 0 && data[i] > 0 ? 1 : 0;
    return { width: canvas.width, height: canvas.height, hidden: canvas.hidden, red };
  });
  assert.deepEqual([map.width, map.height, map.hidden], [64, 36, false]);
  assert.ok(map.red > 64 * 36 / 4, `${map.red} changed pixels`);
  await page.click('#changes-shown');
  assert.deepEqual(await page.evaluate(() => [document.getElementById('changes-map').hidden, window.relight.changes.socket]), [true, null]);
}));
