// The daylight panel: its numbers, and the page under a weather file with the whole program. RELIGHT_RELIGHTD names the server
// program, RELIGHT_WEATHER a script that writes a weather file.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import {
  Year, amount, dayText, falseColour, illuminanceFactor, legend, perUnit, placeOfFrame, sunAt, sunPath,
} from '../../clients/web/daylight_model.js';
import { beginTests, openPage, startServer } from './lib.mjs';

const chromium = await beginTests(['RELIGHT_RELIGHTD', 'RELIGHT_WEATHER']);

test('days, units and colours are the server’s', () => {
  assert.deepEqual([1, 59, 60, 365].map(dayText), ['1 January', '28 February', '1 March', '31 December']);
  assert.equal(perUnit({ units: 0.5 }), 358);
  assert.equal(perUnit({ units: 1 }, 1), 89.5);
  assert.deepEqual([0, 0.5, 1].map(falseColour), ['rgb(18, 12, 60)', 'rgb(62, 184, 110)', 'rgb(206, 44, 44)']);
  assert.deepEqual(legend(1, 100).filter(([, v]) => v === 1 || v === 1000), [[0, 1], [1, 1000]]);
  assert.deepEqual([0, 0.1234, 45.67, 12345].map(amount), ['0', '0.123', '45.7', '12\u202f300']);
});

test('illuminance is pi times the luminance over the albedo, of matte surfaces alone', () => {
  const matte = { sees: 'surface', point: { lobe: { diffuse: [0.5, 0.5, 0.5] } } };
  assert.ok(Math.abs(illuminanceFactor(matte) - 2 * Math.PI) < 1e-9);
  assert.equal(illuminanceFactor({ sees: 'surface', point: { lobe: { diffuse: [1, 1, 1], specular: [1, 1, 1] } } }), null);
  assert.equal(illuminanceFactor({ sees: 'sky' }), null);
});

test('the sun is at its highest at noon, and its path lies above the horizon', () => {
  const place = { latitude: 48, longitude: 15, zone: 1 };
  assert.ok(Math.abs(sunAt(place, 172, 12).elevation - (90 - 48 + 23.44)) < 0.2);
  assert.ok(sunAt(place, 172, 8).azimuth < 130 && sunAt(place, 172, 16).azimuth > 230);
  assert.ok(sunPath(place, 172).length > sunPath(place, 355).length + 20);
});

test('a year keeps each hour’s newest value and a round scale; frames have their day and hour', () => {
  const year = new Year();
  year.add(3, 9.5, 100);
  year.add(3, 9.5, 130);
  assert.deepEqual([...year.values], [[57, 130]]);
  assert.equal(year.top, 200);
  assert.deepEqual(placeOfFrame(1906, { frame: 1905, day: 80, hour: 9.5 }), { day: 80, hour: 10.5 });
});

test('the page goes to a day and hour, shows false colour and the luminance below the pointer', async () => {
  const folder = mkdtempSync(join(tmpdir(), 'relight-daylight-'));
  writeFileSync(join(folder, 'x.epw'), execFileSync(chromium.RELIGHT_WEATHER, ['--latitude', '48', '--longitude', '11', '--zone', '1'], { maxBuffer: 1e7 }));
  const server = await startServer(chromium.RELIGHT_RELIGHTD, ['--port', '0', '--size', '64x36', '--method', 'mis', '--samples', '4',
    '--paths', 'direct', '--source', `epw:${join(folder, 'x.epw')},size=64x32`]);
  const page = await openPage(chromium.browser, `${server.url}?coding=jpeg#role=controller`, { width: 1500, height: 900 });
  const until = (what, value) => page.waitForFunction(what, value);
  const set = (id, value) => page.locator(id).evaluate((input, v) => { input.value = v; input.dispatchEvent(new Event('input')); }, value);
  try {
    await until(() => window.relight?.frames > 0 && window.relight.status?.place && window.relight.app.control);
    await page.locator('#play').click();
    await until(() => window.relight.app.control.paused);
    await set('#scrub-day', 172);
    await set('#scrub', 14.5);
    await until(() => window.relight.status.source.day === 172 && window.relight.status.source.hour === 14.5);
    assert.equal(await page.locator('#scrub-text').textContent(), '21 June, 14:30');
    const status = await page.evaluate(() => window.relight.status);
    const sun = sunAt(status.place, 172, 14.5);
    assert.ok(Math.abs(sun.elevation - status.light.sun.elevation) < 0.5 && Math.abs(sun.azimuth - status.light.sun.azimuth) < 0.5, JSON.stringify([sun, status.light.sun]));
    await page.evaluate(() => { // the server does not hear of it yet
      const { app } = window.relight, { send } = app, held = [];
      app.send = (message) => held.push(message);
      window.release = () => { app.send = send; held.forEach((message) => app.send(message)); };
    });
    await page.locator('#daylight-colour').check();
    assert.ok(await page.evaluate(() => {
      window.relight.daylight.show();
      window.release();
      return document.getElementById('daylight-colour').checked;
    }), 'the choice jumps back until the server answers');
    await until(() => window.relight.app.control.tone === 'false-colour');
    const answer = page.evaluate(() => new Promise((resolve) => { window.relight.app.on('probed', (m) => { if (m.x !== undefined) resolve(m); }); }));
    await page.locator('#picture').hover({ position: { x: 200, y: 200 } });
    const { x, y, picture: [r, g, b] } = await answer;
    const words = `Pixel ${x}, ${y}: ${amount(179 * (0.2126 * r + 0.7152 * g + 0.0722 * b))} cd/m²`;
    await until((want) => document.getElementById('daylight-under').textContent === want, words);
    assert.deepEqual(page.faults, []);
  } finally {
    await page.close();
    await server.stop();
    rmSync(folder, { recursive: true });
  }
});
