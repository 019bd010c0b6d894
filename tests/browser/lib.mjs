// Shared by the browser tests: setup, a server as a child process, Chromium, and waiting.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { existsSync, mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

export const CHROMIUM = process.env.RELIGHT_CHROMIUM ?? '/usr/bin/chromium';
const HANG_MS = 600000; // ends a test that waits for what never comes; no test passes or fails by how long something takes

// The reason why nothing can be tested here, in the form that ctest reports as skipped; or undefined.
export async function whatIsMissing() {
  if (!existsSync(CHROMIUM)) return `no browser at ${CHROMIUM}`;
  try {
    await import('playwright-core');
  } catch {
    return 'playwright-core is not installed: npm ci --ignore-scripts in tests/browser';
  }
  return undefined;
}

// Sets up a test file: the environment variables that name the programs under test, and one shared browser in
// `browser`. Without a browser, or if `missing` names something else, all tests are skipped.
export async function beginTests(variables, missing = () => undefined) {
  const absent = (await whatIsMissing()) ?? missing();
  if (absent) {
    console.log(`skipped: ${absent}`);
    process.exit(0);
  }
  const { after } = await import('node:test');
  const begun = {};
  for (const name of variables) {
    assert.ok(process.env[name], `${name} is not set`);
    begun[name] = process.env[name];
  }
  begun.browser = await openBrowser(); // first, because hooks of the file may need it
  after(async () => { await begun.browser?.close(); });
  return begun;
}

// Starts `command` and waits for the address it prints: {url, port, say(line), text(), ended, stop()}.
export async function startServer(command, args = []) {
  const caches = mkdtempSync(join(tmpdir(), 'relight-caches-')); // no test takes a cache that another one has kept
  const child = spawn(command, args, { stdio: ['pipe', 'ignore', 'pipe'], env: { ...process.env, XDG_CACHE_HOME: caches } });
  child.on('exit', () => rmSync(caches, { recursive: true, force: true }));
  let text = '';
  const ended = new Promise((resolve) => {
    child.on('exit', (code, signal) => resolve({ code, signal }));
  });
  child.stdin.on('error', () => {}); // it may have exited already
  const url = await new Promise((resolve, reject) => {
    const late = setTimeout(() => reject(new Error(`${command} printed no address:\n${text}`)), HANG_MS);
    child.stderr.on('data', (data) => {
      text += data;
      const found = text.match(/listening on (http:\/\/\S+)/);
      if (found) {
        clearTimeout(late);
        resolve(found[1]);
      }
    });
    child.on('error', reject);
    ended.then(() => reject(new Error(`${command} ended before it listened:\n${text}`)));
  });
  return {
    url,
    port: new URL(url).port,
    say: (line) => child.stdin.write(`${line}\n`),
    text: () => text,
    ended,
    kill: (signal) => child.kill(signal),
    async stop() {
      child.kill('SIGTERM');
      const late = setTimeout(() => child.kill('SIGKILL'), HANG_MS);
      const how = await ended;
      clearTimeout(late);
      return how;
    },
  };
}

// Playwright's own list, which ours replaces, and the suggestions of the address bar: pages of their own that Chromium
// loads into each window, half of the processor time of opening one.
const WITHOUT = ['AvoidUnnecessaryBeforeUnloadCheckSync', 'DestroyProfileOnBrowserClose', 'DialMediaRouteProvider',
  'GlobalMediaControls', 'HttpsUpgrades', 'LensOverlay', 'MediaRouter', 'OptimizationHints', 'PaintHolding',
  'ThirdPartyStoragePartitioning', 'Translate', 'WebUIOmniboxAimPopup', 'WebUIOmniboxFullPopup', 'WebUIOmniboxPopup', 'SpareRendererForSitePerProcess'];

// Waiting looks at a page twenty times a second. By default it looks at each frame, and so has the browser draw sixty.
function lookSeldom(page) {
  const wait = page.waitForFunction.bind(page);
  page.waitForFunction = (holds, arg, options) => wait(holds, arg, { polling: 50, ...options });
}

export async function openBrowser() {
  const { chromium } = await import('playwright-core');
  const browser = await chromium.launch({
    executablePath: CHROMIUM,
    args: ['--headless', '--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-background-networking',
      '--disable-component-update', '--disable-sync', '--force-color-profile=srgb', '--force-device-scale-factor=1',
      '--hide-scrollbars', `--disable-features=${WITHOUT}`],
    timeout: HANG_MS,
  });
  for (const kind of ['newPage', 'newContext']) {
    const open = browser[kind].bind(browser);
    browser[kind] = async (options) => {
      const opened = await open(options);
      opened.setDefaultTimeout(HANG_MS);
      if (kind === 'newPage') lookSeldom(opened);
      else opened.on('page', lookSeldom);
      return opened;
    };
  }
  return browser;
}

// Opens the page; a test that checks `faults` fails on its errors.
export async function openPage(browser, url, { width = 1000, height = 800, hasTouch = false } = {}) {
  const page = await browser.newPage({ viewport: { width, height }, hasTouch });
  page.faults = [];
  page.on('pageerror', (error) => page.faults.push(String(error)));
  page.on('console', (message) => {
    // Browsers report each failed connection, which some tests cause on purpose.
    if (message.type() === 'error' && !/ERR_CONNECTION|WebSocket connection|Failed to load/.test(message.text()))
      page.faults.push(message.text());
  });
  await page.goto(url);
  return page;
}

export const state = (page) => page.evaluate(() => window.relight.state.name);
export const sentence = (page) => page.textContent('#sentence');

// Waits until the page is in this state. A busy machine may let it stall in between: what a state shows is waited for, too.
export function untilState(page, name) {
  return page.waitForFunction((n) => window.relight?.state.name === n, name);
}

// Waits until the page's sentence about its state matches.
export function untilSentence(page, pattern) {
  return page.waitForFunction((text) => new RegExp(text).test(document.querySelector('#sentence').textContent), pattern.source);
}

// Waits until `count` more images were drawn.
export async function untilFrames(page, count) {
  const now = await page.evaluate(() => window.relight.frames);
  await page.waitForFunction((n) => window.relight.frames >= n, now + count);
}

// Waits until `count` more statuses of the server have come: what it does not do meanwhile, it does not do.
export async function untilStatuses(page, count) {
  await page.evaluate(() => {
    window.statuses = 0;
    if (!window.counting) window.relight.app.on('status', () => { window.statuses++; });
    window.counting = true;
  });
  await page.waitForFunction((n) => window.statuses >= n, count);
}

// Waits until something holds that is no page's.
export async function until(holds) {
  const end = Date.now() + HANG_MS;
  while (!(await holds())) {
    assert.ok(Date.now() < end, `never came: ${holds}`);
    await new Promise((resolve) => { setTimeout(resolve, 20); });
  }
}

// The current canvas with the header of its image: {width, height, data, header}.
export async function readback(page) {
  const got = await page.evaluate(() => {
    const { width, height, data } = window.relight.readback();
    let text = '';
    for (let i = 0; i < data.length; i += 32768) text += String.fromCharCode(...data.subarray(i, i + 32768));
    return { width, height, base64: btoa(text), header: window.relight.lastHeader };
  });
  return { ...got, data: Buffer.from(got.base64, 'base64') };
}

// Rec.709 luminance of sRGB code values, 0..255: a rough measure of brightness.
export const brightness = (data, i) => 0.2126 * data[i] + 0.7152 * data[i + 1] + 0.0722 * data[i + 2];
