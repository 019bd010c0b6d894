// What the content security policy allows, and that the page needs no more: uses every part of the page and listens
// for violations in window and worker. RELIGHT_RELIGHTD names the server.
import assert from 'node:assert/strict';
import { createServer } from 'node:http';
import { after, test } from 'node:test';
import { beginTests, startServer, until, untilFrames, untilState } from './lib.mjs';

const { browser, RELIGHT_RELIGHTD } = await beginTests(['RELIGHT_RELIGHTD']);

// A site of its own that shows what its query names in a frame.
async function startSite() {
  const site = createServer((request, answer) => {
    const shown = new URL(request.url, 'http://site').searchParams.get('show');
    answer.setHeader('content-type', 'text/html');
    answer.end(`<!doctype html><iframe src="${shown}" width="400" height="300"></iframe><img src="${shown}">`);
  });
  await new Promise((resolve) => { site.listen(0, '127.0.0.1', resolve); });
  after(() => site.close());
  return `http://127.0.0.1:${site.address().port}`;
}
const friend = await startSite();
const stranger = await startSite();

const server = await startServer(RELIGHT_RELIGHTD,
  ['--port', '0', '--size', '96x54', '--samples', '4', '--fps', '10', '--paths', 'direct', '--edge-rays', '1',
    '--source', 'sky:size=128x64,speed=0.5', '--embed-from', friend]);
after(() => server.stop());

// A page with `page.violations`: the window's events, and the browser's messages for everything else.
async function openWatched(url) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 900 } });
  page.violations = [];
  await page.exposeFunction('reportViolation', (what) => page.violations.push(what));
  await page.addInitScript(() => {
    document.addEventListener('securitypolicyviolation', (event) => {
      window.reportViolation(`${event.effectiveDirective}: ${event.blockedURI} ${event.sourceFile}:${event.lineNumber}`);
    });
  });
  page.on('console', (message) => {
    if (/content security policy|refused to|permissions policy/i.test(message.text())) page.violations.push(message.text());
  });
  page.on('pageerror', (error) => page.violations.push(String(error)));
  await page.goto(url);
  return page;
}

test('every part of the page works within the policy', async () => {
  const page = await openWatched(`${server.url}#role=controller`);
  await untilState(page, 'live');
  await untilFrames(page, 3);
  for (const key of ['?', 'Escape', 'p', 'Escape']) await page.keyboard.press(key);
  await page.click('#theme-button');
  await page.click('#panels-button');
  await page.click('#panels-button');
  const box = await page.locator('#picture').boundingBox();
  await page.mouse.click(box.x + 0.45 * box.width, box.y + 0.7 * box.height); // the probe, which draws plots
  await page.click('#sky-panel summary');
  await page.keyboard.press('k'); // the comparison
  for (const id of ['#snapshot-png', '#snapshot-exr'])
    await Promise.all([page.waitForEvent('download'), page.click(id)]);
  await untilFrames(page, 3);
  assert.deepEqual(page.violations, []);
  await page.close();
});

test('a violation would be detected, and is blocked', async () => {
  const page = await openWatched(server.url);
  await untilState(page, 'live');
  const done = await page.evaluate(async () => {
    const script = document.createElement('script');
    script.textContent = 'window.intruded = true';
    document.body.append(script);
    const image = document.createElement('img');
    image.src = 'http://evil.example/spy.gif';
    document.body.append(image);
    const frame = document.createElement('iframe');
    frame.src = '/';
    document.body.append(frame);
    let fetched = true;
    await fetch('http://evil.example/').catch(() => { fetched = false; });
    return { intruded: window.intruded ?? false, fetched };
  });
  assert.deepEqual(done, { intruded: false, fetched: false });
  for (const directive of ['script-src', 'img-src', 'connect-src']) {
    await until(() => page.violations.some((v) => v.includes(directive)));
  }
  await page.close();
});

test('responses have restrictive headers', async () => {
  const page = await browser.newPage();
  const answers = new Map();
  page.on('response', (answer) => answers.set(new URL(answer.url()).pathname, answer.headers()));
  await page.goto(server.url);
  await untilState(page, 'live');
  for (const path of ['/', '/app.js', '/worker.js', '/style.css']) {
    const headers = answers.get(path);
    assert.ok(headers, `${path} was not asked for`);
    assert.match(headers['content-security-policy'], /^default-src 'none'; script-src 'self';/);
    assert.doesNotMatch(headers['content-security-policy'], /unsafe|\*/);
    assert.match(headers['content-security-policy'], /frame-ancestors 'none'/);
    assert.equal(headers['x-content-type-options'], 'nosniff');
    assert.equal(headers['referrer-policy'], 'no-referrer');
    assert.equal(headers['cross-origin-opener-policy'], 'same-origin');
    assert.equal(headers['cross-origin-resource-policy'], 'same-origin');
  }
  await page.close();
});

test('a token in the address is never sent', async () => {
  const page = await browser.newPage();
  const asked = [];
  page.on('request', (request) => asked.push(`${request.url()} ${JSON.stringify(request.headers())}`));
  await page.goto(`${server.url}#token=a-secret-of-the-test`);
  await untilState(page, 'live');
  assert.ok(asked.length > 3);
  // the browser's debugging protocol shows the page's fragment, which is not sent
  assert.deepEqual(asked.filter((line) => line.replace(`${server.url}#token=a-secret-of-the-test`, '').includes('secret')), []);
  assert.doesNotMatch(server.text(), /secret/);
  await page.close();
});

test('/embed shows the image alone, also in a frame of a site that may, and nothing else does', async () => {
  const page = await openWatched(`${server.url}embed#role=controller`);
  await untilFrames(page, 3);
  assert.equal(await page.locator('body').innerText(), '');
  const { width, height } = page.viewportSize();
  assert.deepEqual(await page.locator('#picture').boundingBox(), { x: 0, y: 0, width, height });
  assert.deepEqual(page.violations, []);

  const framed = async (site, path) => {
    await page.goto(`${site}/?show=${encodeURIComponent(server.url + path)}`);
    const frame = page.frames().find((f) => f !== page.mainFrame());
    // A blocked frame has the browser's own page instead, whose script cannot be seen.
    return frame.waitForFunction(() => window.relight?.frames > 2 || location.protocol === 'chrome-error:')
      .then(() => frame.evaluate(() => window.relight?.frames > 2));
  };
  assert.equal(await framed(friend, 'embed'), true);
  assert.equal(await framed(stranger, 'embed'), false);
  assert.equal(await framed(friend, ''), false);
  await page.close();
});

test('a browser shows snapshots and the stream, but to no other site', async () => {
  const page = await browser.newPage();
  for (const path of ['snapshot.jpg', 'snapshot.png?width=80', 'stream.mjpeg']) {
    await page.goto(server.url + path, { waitUntil: 'commit' });
    await page.waitForFunction(() => document.images[0]?.naturalWidth > 0);
    assert.equal(await page.evaluate(() => document.images[0].naturalWidth), path.includes('80') ? 80 : 96);
  }
  await page.goto(`${stranger}/?show=${encodeURIComponent(`${server.url}snapshot.jpg`)}`);
  await page.waitForFunction(() => document.images[0].complete);
  assert.equal(await page.evaluate(() => document.images[0].naturalWidth), 0);
  await page.close();
});

test('a server with tokens asks for one, which lasts as long as the tab', async () => {
  const guarded = await startServer(RELIGHT_RELIGHTD, ['--port', '0', '--size', '96x54', '--samples', '4', '--fps', '10', '--method', 'mis',
    '--source', 'sky:size=128x64,speed=0.5', '--token-viewer', 'look', '--token-controller', 'steer']);
  const type = async (page, token) => {
    await page.fill('#token', token);
    await page.click('#access button');
  };
  try {
    const page = await openWatched(guarded.url);
    await untilState(page, 'refused');
    assert.ok(await page.locator('#access').isVisible());
    await type(page, 'wrong');
    await page.waitForFunction(() => document.getElementById('access-note').textContent.includes('does not accept'));
    await type(page, 'look');
    await untilFrames(page, 2);
    assert.equal(await page.locator('#access').isVisible(), false);
    assert.equal(await page.evaluate(() => window.relight.app.role), 'viewer');
    await page.reload();
    await untilFrames(page, 2);
    assert.equal(await page.evaluate(() => window.relight.app.role), 'viewer');
    assert.equal(page.url(), guarded.url);
    assert.deepEqual(page.violations, []);
    await page.close();

    const other = await openWatched(guarded.url);
    await untilState(other, 'refused'); // another tab knows nothing of it
    await type(other, 'steer');
    await untilFrames(other, 2);
    assert.equal(await other.evaluate(() => window.relight.app.role), 'controller');
    await other.close();
    assert.doesNotMatch(guarded.text(), /look|steer/);
  } finally {
    await guarded.stop();
  }
});
