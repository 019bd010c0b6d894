#!/usr/bin/env node
// Takes the screenshot of the pixel probe in docs/probe.md: the page of a server with these arguments, one pixel probed
// with the preset of Fig. 1 of Lu, Pacanowski and Granier 2013.
// usage: probe.mjs BIN OUT.jpg X,Y relightd's arguments ...   (npm ci in tests/browser first)
import { openBrowser, openPage, startServer } from '../../tests/browser/lib.mjs';

const [bin, out, pixel, ...args] = process.argv.slice(2);
const [x, y] = pixel.split(',').map(Number);
const server = await startServer(`${bin}/relightd`, ['--port', '0', ...args]);
const browser = await openBrowser();
try {
  const page = await openPage(browser, server.url, { width: 1500, height: 860 });
  await page.waitForFunction(() => window.relight.frames > 0 && window.relight.status?.width > 0, null, { timeout: 600000 });
  await page.evaluate(() => { document.documentElement.dataset.theme = 'dark'; });
  await page.evaluate(([px, py]) => {
    const { probe } = window.relight;
    probe.preset.setAttribute('aria-pressed', 'true');
    probe.samples.disabled = true;
    probe.picker.choose({ x: px, y: py });
  }, [x, y]);
  await page.waitForFunction(() => window.relight.probe.answer?.preset === 'fig1', null, { timeout: 60000 });
  await page.evaluate(() => document.getElementById('probe').scrollIntoView());
  await page.waitForTimeout(1500);
  await page.screenshot({ path: out, type: 'jpeg', quality: 82 });
  console.log(await page.textContent('#probe-words'));
} finally {
  await browser.close();
  await server.stop();
}
