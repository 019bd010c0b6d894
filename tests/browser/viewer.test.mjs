// The page in Chromium on images whose every pixel is known, drawn by pattern_server.c. RELIGHT_PATTERN_SERVER names
// that program.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  beginTests, openPage, readback, startServer, state, untilFrames, untilSentence, untilState, untilStatuses,
} from './lib.mjs';

const chromium = await beginTests(['RELIGHT_PATTERN_SERVER']);
const PATTERN = chromium.RELIGHT_PATTERN_SERVER;
const BEGUN_MS = Date.now();

// Runs `body` with a server and a page on it, and closes both.
async function withPage(args, body, options) {
  const server = await startServer(PATTERN, ['--fps', '10', ...args]);
  const page = await openPage(chromium.browser, server.url, options);
  try {
    await body(page, server);
    assert.deepEqual(page.faults, []);
  } finally {
    await page.close();
    await server.stop();
  }
}

// A group of tests on one page, in this order: opening a page costs as much processor time as three seconds of images.
const onOnePage = (title, args, tests, options) => test(title, (t) => withPage(args, async (page, server) => {
  await untilState(page, 'live');
  for (const [name, body] of Object.entries(tests)) await t.test(name, () => body(page, server));
}, options));

// What pattern_server.c draws at (x, y) of a frame.
const QUARTERS = [[200, 40, 40], [40, 170, 60], [50, 70, 200], [220, 190, 40]];
function wanted(frame, x, y, width, height) {
  if (y >= height - 16 && x < 256) return Array(3).fill(((frame >> (x >> 4)) & 1) * 255);
  const bar = (frame * 8) % width;
  if ((x + width - bar) % width < 16) return [255, 255, 255];
  return QUARTERS[(y >= height / 2 ? 2 : 0) + (x >= width / 2 ? 1 : 0)];
}

// The largest difference, in code values, away from edges, where JPEG rings.
function compare({ width, height, data, header }) {
  let worst = 0;
  let seen = 0;
  for (let y = 4; y < height - 4; y += 3) {
    for (let x = 4; x < width - 4; x += 3) {
      const want = wanted(header.frame, x, y, width, height);
      // skip 8 x 8 blocks that contain an edge
      const bx = x & ~7;
      const by = y & ~7;
      const flat = [[bx, by], [bx + 7, by], [bx, by + 7], [bx + 7, by + 7]].every(([cx, cy]) =>
        wanted(header.frame, Math.min(cx, width - 1), Math.min(cy, height - 1), width, height).every((v, c) => v === want[c]));
      if (!flat) continue;
      seen++;
      for (let c = 0; c < 3; c++) worst = Math.max(worst, Math.abs(data[(y * width + x) * 4 + c] - want[c]));
    }
  }
  assert.ok(seen > 1000);
  return worst;
}

// Headless Chromium has no hidden tabs; the page is made to believe that it is one.
const setHidden = (page, hidden) => page.evaluate((h) => {
  Object.defineProperty(document, 'visibilityState', { value: h ? 'hidden' : 'visible', configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}, hidden);

onOnePage('the page and its images', ['--size', '320x180', '--fps', '20'], {
  async 'every pixel has its position and colour, in image after image'(page) {
    await untilState(page, 'live');
    const frames = new Set();
    for (let i = 0; i < 6; i++) {
      await untilFrames(page, 2);
      const got = await readback(page);
      assert.equal(got.width, 320);
      assert.equal(got.height, 180);
      const worst = compare(got);
      assert.ok(worst <= 4, `frame ${got.header.frame}: off by ${worst}`);
      frames.add(got.header.frame);
    }
    assert.equal(frames.size, 6); // it moved
  },

  async 'keys and buttons work'(page) {
    await untilState(page, 'live');
    // by keyboard alone: every button is reached in order and shows its focus
    const names = [];
    for (let i = 0; i < 7; i++) {
      await page.keyboard.press('Tab');
      names.push(await page.evaluate(() => document.activeElement.getAttribute('aria-label')));
      assert.notEqual(await page.evaluate(() => getComputedStyle(document.activeElement).outlineStyle), 'none');
    }
    assert.deepEqual(names, ['Save the image as PNG', 'Save the linear image as EXR', 'Keep this image and compare',
      'Panels', 'Dark or light page', 'Help and keys', 'Full screen']);
    assert.ok(await page.isVisible('#fps'));
    await page.keyboard.press('i');
    assert.ok(!(await page.isVisible('#panels')));
    assert.equal(await page.getAttribute('#panels-button', 'aria-pressed'), 'false');
    await page.click('#panels-button');
    assert.ok(await page.isVisible('#fps'));
    await page.click('#figures summary'); // each panel folds separately, and stays so
    assert.ok(!(await page.isVisible('#fps')));
    await page.waitForFunction(() => Object.values(JSON.parse(localStorage.getItem('relight.folded') ?? '{}')).includes(false));
    await page.reload();
    await untilState(page, 'live');
    assert.ok(!(await page.isVisible('#fps')));
    await page.focus('#figures summary');
    await page.keyboard.press('Enter');
    assert.ok(await page.isVisible('#fps'));
    await page.keyboard.press('f');
    await page.waitForFunction(() => document.fullscreenElement?.id === 'stage');
    await page.keyboard.press('f');
    await page.waitForFunction(() => !document.fullscreenElement);
    await page.click('#full-button');
    await page.waitForFunction(() => document.fullscreenElement?.id === 'stage');
    const box = await page.locator('#picture').boundingBox();
    assert.ok(box.width >= 990 && box.height >= 790, `${box.width} x ${box.height} of 1000 x 800`);
    await page.keyboard.press('f');
    await page.waitForFunction(() => !document.fullscreenElement);
  },

  async 'the page describes what it shows, with live statistics'(page) {
    await untilState(page, 'live');
    await untilFrames(page, 40);
    assert.equal(await page.textContent('#about'),
      'A test pattern under no sky at all; 320\u00a0×\u00a0180, 64 samples per point, method mis.');
    await page.waitForFunction(() => parseFloat(document.getElementById('fps').textContent) > 0);
    await page.waitForFunction(() => parseFloat(document.getElementById('latency').textContent) >= 0);
    await page.waitForFunction(() => parseFloat(document.getElementById('round-trip').textContent) >= 0);
    assert.match(await page.textContent('#clock'), /^± /);
    assert.match(await page.textContent('#ms-decoded'), /^1\.5 ms$/);
    assert.match(await page.textContent('#sun-text'), /14:35 solar time, sun /);
    assert.ok(await page.isVisible('#sky'));
    const grow = await page.evaluate(() => getComputedStyle(document.getElementById('bar-decoded')).flexGrow);
    assert.ok(parseFloat(grow) > 0);
    const before = Number(await page.textContent('#frame'));
    await untilFrames(page, 10);
    await page.waitForFunction((n) => Number(document.getElementById('frame').textContent) > n, before);
    // capture to display cannot be negative, nor longer than the server runs
    const latency = await page.evaluate(() => window.relight.latencyMs);
    assert.ok(latency >= 0 && latency < Date.now() - BEGUN_MS, `${latency} ms`);
  },

  async 'a hidden page receives no images and a visible one resumes at once'(page) {
    await untilState(page, 'live');
    await untilFrames(page, 3);
    await setHidden(page, true);
    await untilState(page, 'paused');
    await untilSentence(page, /hidden/);
    await untilStatuses(page, 2); // by now everything under way has arrived
    const frames = await page.evaluate(() => window.relight.frames);
    await untilStatuses(page, 4);
    assert.equal(await page.evaluate(() => window.relight.frames), frames);
    await setHidden(page, false);
    await untilState(page, 'live');
    await untilFrames(page, 3);
    // late, repeated and crossing events end in the last one's state
    for (const hidden of [true, false, true, true, false]) await setHidden(page, hidden);
    await untilState(page, 'live');
    await untilFrames(page, 3);
  },

  async 'help lists every key, and blocks the page behind it'(page) {
    await untilState(page, 'live');
    await page.keyboard.press('?');
    const rows = await page.$$eval('#help tr', (all) => all.map((row) => row.textContent));
    assert.equal(rows.length, await page.evaluate(() => window.relight.app.rows));
    assert.ok(rows.some((row) => row.startsWith('F') && /full screen/i.test(row)), rows.join('; '));
    await page.keyboard.press('i'); // nothing happens behind the overlay
    assert.ok(!(await page.evaluate(() => document.body.classList.contains('plain'))));
    await page.keyboard.press('?');
    assert.ok(!(await page.isVisible('#help')));
    await page.click('#help-button');
    await page.keyboard.press('Escape');
    assert.ok(!(await page.isVisible('#help')));
  },

  async 'a frozen server is noticed'(page, server) {
    await untilState(page, 'live');
    server.kill('SIGSTOP');
    await page.waitForFunction(() => ['stalled', 'reconnecting', 'connecting'].includes(window.relight.state.name));
    await untilState(page, 'reconnecting');
    server.kill('SIGCONT');
    await untilState(page, 'live');
    await untilFrames(page, 3);
  },

  async 'a slow round trip fits its tile'(page) {
    await untilState(page, 'live');
    for (const [width, height] of [[320, 640], [390, 844], [640, 900]]) {
      await page.setViewportSize({ width, height });
      const out = await page.evaluate(() => {
        document.getElementById('round-trip').textContent = '1234 ms';
        document.getElementById('clock').textContent = '± 617 ms';
        const edge = (id) => document.getElementById(id).getBoundingClientRect().right;
        const tile = document.getElementById('clock').closest('div').getBoundingClientRect().right;
        return Math.max(edge('clock'), edge('round-trip')) - tile;
      });
      assert.ok(out <= 0.5, `${out} px too far at ${width}`);
    }
    await page.setViewportSize({ width: 1000, height: 800 });
  },

  // Relative luminance and contrast as WCAG 2 defines them.
  async 'all text has a contrast of at least 4.5 to 1'(page, server) {
    await untilState(page, 'live');
    server.say('fail torn');
    await untilState(page, 'failed');
    const poor = await page.evaluate(() => {
      const parse = (text) => text.match(/[\d.]+/g).map(Number);
      const luminance = ([r, g, b]) => [r, g, b].map((v) => v / 255)
        .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
      const ground = (element) => {
        for (let e = element; e; e = e.parentElement) {
          const color = parse(getComputedStyle(e).backgroundColor);
          if ((color[3] ?? 1) > 0.9) return color;
        }
        return [0, 0, 0];
      };
      const found = [];
      for (const element of document.querySelectorAll('h1, p, dt, dd, span, button, small')) {
        if (!element.textContent.trim() || element.closest('#veil') || !element.checkVisibility()) continue;
        const [a, b] = [luminance(parse(getComputedStyle(element).color)), luminance(ground(element))];
        const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (contrast < 4.5) found.push(`${element.tagName} "${element.textContent.trim().slice(0, 20)}" ${contrast.toFixed(2)}`);
      }
      return found;
    });
    assert.deepEqual(poor, []);
    // and screen readers get a description
    assert.equal(await page.getAttribute('#sentence', 'aria-live'), 'polite');
    assert.match(await page.getAttribute('#picture', 'aria-label'), /^A test pattern under/);
  },
});

onOnePage('on an upright phone', [], {
  async 'keyboard focus is never behind the image at the top'(page) {
    await untilState(page, 'live');
    await untilFrames(page, 1);
    let below = 0;
    for (const key of [...Array(60).fill('Tab'), ...Array(60).fill('Shift+Tab')]) {
      await page.keyboard.press(key);
      const hidden = await page.evaluate(() => {
        const at = document.activeElement, stage = document.getElementById('stage');
        if (at === document.body || stage.contains(at) || at.closest('dialog')) return null;
        const [own, above] = [at, stage].map((e) => e.getBoundingClientRect());
        return Math.min(own.bottom, above.bottom) - Math.max(own.top, above.top);
      });
      below += hidden !== null;
      assert.ok(!(hidden > 1), `${hidden} pixels of it are behind the picture`);
    }
    assert.ok(below > 40, `${below} looked at`);
  },

  async 'on an upright phone the button scrolls to the panels, then hides them; the image stays in sight'(page) {
    await untilState(page, 'live');
    await untilFrames(page, 1);
    await page.evaluate(() => { document.getElementById('panels').style.margin = '100vh 0'; }); // as with many panels
    await page.click('#panels-button');
    await page.waitForFunction(() => document.getElementById('panels').getBoundingClientRect().top < window.innerHeight / 2);
    assert.ok(await page.isVisible('#fps'));
    const top = await page.evaluate(() => document.getElementById('stage').getBoundingClientRect().top);
    assert.ok(top >= -1, `the picture begins at ${top}`);
    await page.evaluate(() => document.getElementById('panels-button').click());
    assert.ok(!(await page.isVisible('#panels')));
  },
}, { width: 390, height: 844 });

test('the canvas follows the size of the image', () =>
  withPage(['--size', '320x184'], async (page, server) => {
    await untilState(page, 'live');
    for (const size of ['640x352', '272x480', '320x184']) {
      server.say(`size ${size}`);
      const [width, height] = size.split('x').map(Number);
      await page.waitForFunction(([w, h]) => window.relight.lastHeader?.width === w && window.relight.lastHeader.height === h,
        [width, height]);
      const got = await readback(page);
      assert.deepEqual([got.width, got.height], [width, height]);
      assert.ok(compare(got) <= 4);
    }
  }));

test('each state of the source has its sentence, before the first image and after', () =>
  withPage(['--quiet'], async (page, server) => {
    await untilState(page, 'waiting');
    await untilSentence(page, /^Waiting for a sky/);
    assert.ok(await page.isVisible('#veil-sentence'));
    assert.match(await page.textContent('#veil-sentence'), /^Waiting for a sky/);
    server.say('state live');
    server.say('go');
    await untilState(page, 'live');
    await untilFrames(page, 2);
    await untilSentence(page, /^Live\.$/);
    await page.waitForFunction(() => !document.getElementById('veil').checkVisibility());
    server.say('fail sky.0012.exr: byte 4711: torn');
    await untilState(page, 'failed');
    await untilSentence(page, /^A sky frame could not be used: sky\.0012\.exr: byte 4711: torn\. The last image stays on screen\.$/);
    assert.ok(await page.isVisible('#notice'));
    await page.waitForFunction(() => document.getElementById('refusal').textContent.includes('sky.0012.exr'));
    server.say('state ended');
    await untilState(page, 'ended');
    await untilSentence(page, /has ended\. The last image stays/);
    server.say('state paused');
    await untilState(page, 'paused');
    await untilSentence(page, /paused/);
    server.say('state live');
    server.say('stop');
    await untilState(page, 'stalled');
    await untilSentence(page, /has sent no image for \d+ s/);
    server.say('go');
    await untilState(page, 'live');
  }));

test('a restarted server is found again, with its new session', () =>
  withPage(['--fps', '20'], async (page, server) => {
    await untilState(page, 'live');
    await untilFrames(page, 10);
    await server.stop();
    await untilState(page, 'reconnecting');
    await untilSentence(page, /The last image stays on screen\. Retrying$/);
    await page.waitForSelector('#notice button'); // while it waits for the next attempt
    assert.ok(compare(await readback(page)) <= 4); // the image stays
    const again = await startServer(PATTERN, ['--port', server.port, '--fps', '20']);
    try {
      await untilState(page, 'live');
      await untilFrames(page, 5);
      assert.ok((await readback(page)).header.sequence < 1000);
      assert.ok(compare(await readback(page)) <= 4);
    } finally {
      await again.stop();
    }
  }));

test('a page that draws nothing holds two images and no more, and then gets the newest', () =>
  withPage(['--fps', '60'], async (page) => {
    await untilFrames(page, 3);
    const before = await page.evaluate(() => {
      window.realFrame = window.requestAnimationFrame;
      window.requestAnimationFrame = (then) => { window.held = then; return 1; };
      return window.relight.lastHeader.sequence;
    });
    await page.waitForTimeout(2000);
    const after = await page.evaluate(() => {
      window.requestAnimationFrame = window.realFrame;
      window.held?.();
      return window.relight.lastHeader.sequence;
    });
    // Images under way, not those of two seconds; a page on a busy machine is sent one in several.
    assert.ok(after - before <= 30, `${after - before}`);
    await page.waitForFunction((n) => window.relight.lastHeader.sequence > n + 60, before);
    await untilState(page, 'live');
  }));

test('the theme is the system’s until the user chooses', async () => {
  const server = await startServer(PATTERN, []);
  const ground = (page) => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const page = await chromium.browser.newPage({ colorScheme: 'light' });
  try {
    await page.goto(server.url);
    await untilState(page, 'live');
    const light = await ground(page);
    assert.equal(await page.evaluate(() => document.documentElement.dataset.theme), 'light');
    await page.emulateMedia({ colorScheme: 'dark' });
    await page.waitForFunction(() => document.documentElement.dataset.theme === 'dark');
    assert.notEqual(await ground(page), light);
    await page.keyboard.press('d');
    assert.equal(await ground(page), light);
    await page.reload();
    await untilState(page, 'live');
    assert.equal(await ground(page), light);
    await page.click('#theme-button');
    assert.notEqual(await ground(page), light);
  } finally {
    await page.close();
    await server.stop();
  }
});

test('nothing overflows at any width, in any state', () =>
  withPage(['--quiet'], async (page, server) => {
    const sizes = [[320, 640], [390, 844], [844, 390], [1280, 720], [1920, 1080]];
    const each = async (check) => {
      for (const [width, height] of sizes) {
        await page.setViewportSize({ width, height });
        assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= document.documentElement.clientWidth),
          `${await state(page)} at ${width}`);
        await check?.(width, height);
      }
    };
    await untilState(page, 'waiting');
    await each();
    server.say('state live');
    server.say('go');
    await untilState(page, 'live');
    await untilFrames(page, 1);
    await each(async (width, height) => {
      const box = await page.locator('#picture').boundingBox();
      assert.ok(box.width * box.height >= 0.2 * width * height, `the picture has ${box.width} x ${box.height} of ${width} x ${height}`);
    });
    server.say('fail a/path/that/is/rather/long/and/has/no/blank/in/it/sky.0012.exr: byte 4711: the chunk ends early');
    await untilState(page, 'failed');
    await each();
  }));

test('without workers the page itself decodes', async () => {
  const server = await startServer(PATTERN, ['--fps', '20']);
  const page = await chromium.browser.newPage();
  try {
    await page.addInitScript(() => { delete window.Worker; });
    await page.goto(server.url);
    await untilState(page, 'live');
    await untilFrames(page, 5);
    assert.ok(compare(await readback(page)) <= 4);
  } finally {
    await page.close();
    await server.stop();
  }
});

test('another site cannot open the stream', async () => {
  const server = await startServer(PATTERN, []);
  const page = await chromium.browser.newPage();
  try {
    await page.goto('about:blank'); // its origin is null
    const opened = await page.evaluate((url) => new Promise((resolve) => {
      const socket = new WebSocket(url, 'relight.v1');
      socket.onopen = () => resolve(true);
      socket.onerror = () => resolve(false);
    }), `ws://127.0.0.1:${server.port}/ws`);
    assert.equal(opened, false);
  } finally {
    await page.close();
    await server.stop();
  }
});
