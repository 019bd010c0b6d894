// The model of the controls, without a page.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { turned } from '../../clients/web/controls_drag.js';
import {
  Wishes, changesText, degreesText, errorOf, hourText, join, next, noiseOf, stepWish, stopsText, transportOf, withPresent,
  wrapDegrees,
} from '../../clients/web/controls_model.js';
import { Keys, isTaken, keyName, keyOf } from '../../clients/web/keys.js';
import { formatView, orbited, parseView } from '../../clients/web/controls_orbit.js';
import { wishedPictures, wishedRole } from '../../clients/web/role.js';

function wishes() {
  const all = { sent: [], now: 0 };
  all.wishes = new Wishes((message) => all.sent.push(message), () => all.now);
  return all;
}

test('one request is pending, and the newest change of each kind waits', () => {
  const { wishes: w, sent } = wishes();
  w.ask({ rotate_degrees: 1 });
  for (let i = 2; i <= 50; i++) w.ask({ rotate_degrees: i });
  w.ask({ tone: 'linear' });
  assert.deepEqual(sent, [{ op: 'control', request: 1, rotate_degrees: 1 }]);
  assert.deepEqual(w.over({ rotate_degrees: 0, samples: 4 }), { rotate_degrees: 50, samples: 4, tone: 'linear' });
  assert.equal(w.answered(7), false); // another client's
  assert.equal(w.answered(1), true);
  assert.deepEqual(sent[1], { op: 'control', request: 2, rotate_degrees: 50, tone: 'linear' });
  w.answered(2);
  assert.equal(sent.length, 2);
  assert.deepEqual(w.over({ rotate_degrees: 50 }), { rotate_degrees: 50 });
});

test('a missing answer does not block the next change', () => {
  const all = wishes();
  all.wishes.ask({ samples: 1 });
  all.now = 3000;
  all.wishes.ask({ samples: 2 });
  assert.equal(all.sent.length, 2);
});

test('successive changes are merged as the server merges them', () => {
  assert.deepEqual(join({ step: 2 }, { step: 1 }), { step: 3 });
  assert.deepEqual(join({ step: 2 }, { seek: 5 }), { seek: 5 });
  assert.deepEqual(join({ seek: 5 }, { hour: 3 }), { hour: 3 });
  assert.deepEqual(join({ hour: 5 }, { step: -1 }), { hour: 5, step: -1 });
  assert.deepEqual(join({ samples: 4 }, { error: 0.1 }), { error: 0.1 });
  assert.deepEqual(join({ error: 0.1 }, { samples: 4 }), { samples: 4 });
  assert.deepEqual(join({ samples: 4 }, { error: null }), { samples: 4, error: null });
});

test('the timeline is that of the source', () => {
  const of = (source) => transportOf({ source });
  assert.deepEqual(of({ kind: 'files', position: 4, length: 67, hour: null }),
    { play: true, step: true, scrub: { least: 0, most: 66, step: 1, value: 4 }, text: '5 of 67' });
  assert.equal(of({ kind: 'sky', position: 4, length: null, hour: 14.6 }).scrub.value, 14.6);
  assert.equal(of({ kind: 'sky', position: 4, length: null, hour: 14.6 }).text, '14:36');
  assert.deepEqual(of({ kind: 'files', position: 4, length: null, hour: null }), { play: true, step: true, scrub: null, text: '' });
  for (const kind of ['folder', 'live', 'producer']) {
    assert.equal(of({ kind, position: 0, length: null, hour: null }).scrub, null);
    assert.equal(of({ kind, position: 0, length: null, hour: null }).step, false);
    assert.equal(of({ kind, position: 0, length: null, hour: null }).play, true);
  }
  assert.equal(of({ kind: 'files', position: 0, length: 1, hour: null }).play, false);
  assert.deepEqual(of({ kind: 'sky', position: 0, length: null, hour: null }),
    { play: true, step: false, scrub: null, text: '' }, 'nobody sends a computed sky, and it can be paused before its hour is known');
  assert.equal(transportOf({ source: { state: 'live', detail: '' } }).play, false); // minor version 0
  assert.equal(transportOf(null).text, '');
});

test('a step pauses the source; a leap is ten frames or an hour', () => {
  assert.deepEqual(stepWish({ source: { kind: 'files', length: 67 } }, -1, false), { paused: true, step: -1 });
  assert.deepEqual(stepWish({ source: { kind: 'files', length: 67 } }, 1, true), { paused: true, step: 10 });
  assert.deepEqual(stepWish({ source: { kind: 'files', length: 4 } }, 1, true), { paused: true, step: 3 });
  assert.deepEqual(stepWish({ source: { kind: 'sky', length: null, hour: 23.5 } }, 1, true), { paused: true, hour: 0.5 });
  assert.deepEqual(stepWish({ source: { kind: 'sky', length: null, hour: 0.5 } }, -1, true), { paused: true, hour: 23.5 });
});

test('choices are cyclic and include the current value', () => {
  assert.equal(next([1, 2, 4], 4), 1);
  assert.equal(next([1, 2, 4], 1, -1), 4);
  assert.equal(next([1, 2, 4], 3), 4);
  assert.equal(next([1, 2, 4], 9), 1);
  assert.equal(next(['a', 'b'], 'a'), 'b');
  assert.deepEqual(withPresent([1, 2, 4], 3), [1, 2, 3, 4]);
  assert.deepEqual(withPresent(['direct', 'all'], 'caustics'), ['direct', 'all', 'caustics']);
  assert.deepEqual(withPresent([1], undefined), [1]);
});

test('numbers are readable', () => {
  assert.equal(degreesText(270), '-90°');
  assert.equal(wrapDegrees(-3600), 0);
  assert.equal(stopsText(1), '+1.0 EV');
  assert.equal(stopsText(-2.5), '−2.5 EV');
  assert.equal(hourText(23.999999999), '00:00');
  assert.equal(hourText(6.25), '06:15');
  assert.equal(errorOf(0.05), 0.0025);
  assert.ok(Math.abs(noiseOf(errorOf(0.05)) - 0.05) < 1e-12);
});

test('changes by others are described in words', () => {
  const before = { tone: 'filmic', rotate_degrees: 0, paused: false, error: null, exposure_stops: null };
  assert.equal(changesText(before, { ...before }), '');
  assert.equal(changesText(before, { ...before, tone: 'linear', rotate_degrees: 90 }),
    'the sky\u2019s rotation: 90°, the tone curve: linear');
  assert.equal(changesText(before, { ...before, error: 0.01 }), 'the target noise: 10 %');
  assert.equal(changesText({ ...before, exposure_stops: 2 }, before), 'the exposure: follow');
});

test('a drag to the right rotates the view ahead to the right', () => {
  assert.equal(turned(0, 100, 1200), -10);
  assert.equal(turned(-175, 100, 1200), 175);
});

test('keys have names, and focused elements come first', () => {
  const event = (key, more = {}) => ({ key, ctrlKey: false, metaKey: false, altKey: false, shiftKey: false, ...more });
  assert.equal(keyOf(event('F')), 'f');
  assert.equal(keyOf(event('G', { shiftKey: true })), 'Shift+g');
  assert.equal(keyOf(event('?', { shiftKey: true })), '?');
  assert.equal(keyOf(event('f', { ctrlKey: true })), '');
  assert.equal(keyOf(event('ArrowLeft', { shiftKey: true })), 'Shift+ArrowLeft');
  assert.equal(keyName('Shift+ArrowLeft'), 'Shift + ←');
  assert.equal(keyName('+'), '+');
  const on = (tagName, type, key) => isTaken({ tagName, type }, key);
  assert.equal(on('BUTTON', '', ' '), true);
  assert.equal(on('BUTTON', '', 'f'), false);
  assert.equal(on('INPUT', 'range', 'ArrowLeft'), true);
  assert.equal(on('INPUT', 'range', 'f'), false);
  assert.equal(on('INPUT', 'range', ' '), false); // pauses, also after the timeline was dragged
  assert.equal(on('INPUT', 'checkbox', ' '), true);
  assert.equal(on('INPUT', 'text', 'f'), true);
  assert.equal(on('SELECT', '', 'm'), true);
  assert.equal(on('BODY', '', ' '), false);
  assert.equal(isTaken({ tagName: 'DIV', dataset: { keys: 'ArrowLeft' } }, 'ArrowLeft'), true);
});

test('each key has one action', () => {
  const keys = new Keys();
  const pressed = [];
  keys.add(['a', 'b'], 'first', () => pressed.push('first'));
  assert.throws(() => keys.add('b', 'second', () => {}), /first/);
  const press = (key) => keys.press({ key, target: {}, preventDefault() {} });
  assert.equal(press('b'), true);
  assert.equal(press('c'), false);
  assert.deepEqual(pressed, ['first']);
});

test('the role comes from the address; by default the server’s machine controls', () => {
  const role = (hash, hostname) => wishedRole({ hash, hostname });
  assert.deepEqual(role('', '127.0.0.1'), { role: 'controller', token: undefined });
  assert.equal(role('', 'localhost').role, 'controller');
  assert.equal(role('', '[::1]').role, 'controller');
  assert.equal(role('', 'sky.example.org').role, 'viewer');
  assert.equal(role('', '127.0.0.1.example.org').role, 'viewer');
  assert.deepEqual(role('#role=controller&token=a%20b', 'sky.example.org'), { role: 'controller', token: 'a b' });
  assert.equal(role('#role=viewer', 'localhost').role, 'viewer');
  assert.equal(role('#role=producer', 'sky.example.org').role, 'viewer');
});

test('the address limits frame rate, width and coding', () => {
  assert.deepEqual(wishedPictures({ search: '?rate=7.5&width=320&coding=jpeg' }), { coding: 'jpeg', maxRate: 7.5, maxWidth: 320 });
  const nothing = { coding: null, maxRate: undefined, maxWidth: undefined };
  for (const search of ['', '?rate=0&width=0', '?rate=-1&width=1.5', '?rate=1001&width=16385', '?rate=fast&width=', '?rate=NaN&width=Infinity'])
    assert.deepEqual(wishedPictures({ search }), nothing);
});

test('the age of a pending request is known until its answer', () => {
  let now = 1000;
  const wishes = new Wishes(() => {}, () => now);
  assert.equal(wishes.waitedMs, 0);
  wishes.ask({ tone: 'linear' });
  now = 1700;
  assert.equal(wishes.waitedMs, 700);
  wishes.answered(wishes.request);
  assert.equal(wishes.waitedMs, 0);
  wishes.ask({ tone: 'filmic' });
  now = 1800;
  wishes.forget();
  assert.equal(wishes.waitedMs, 0);
});

test('a view is turned about what it looks at', () => {
  const view = parseView('@0,1,10;0,1,0;40');
  assert.deepEqual(view, { position: [0, 1, 10], target: [0, 1, 0], fov: 40 });
  assert.equal(formatView(view), '@0,1,10;0,1,0;40');
  for (const bad of [null, '', 'main', '@', '@1,2,3;4,5,6', '@1,2;3,4,5;6', '@a,2,3;4,5,6;7', '@1,2,3;4,5,6;0']) assert.equal(parseView(bad), null);
  const near = (a, b) => a.forEach((x, i) => assert.ok(Math.abs(x - b[i]) < 1e-9, `${a} instead of ${b}`));
  near(orbited(view, -0.5, 0).position, [10, 1, 0]); // dragged to the left, it comes from the right
  near(orbited(view, 1, 0).position, [0, 1, -10]);
  near(orbited(view, 0, 0.25).position, [0, 1 + 10 * Math.SQRT1_2, 10 * Math.SQRT1_2]);
  near(orbited(view, 0, 0, 2).position, [0, 1, 20]);
  const steep = orbited(view, 0, 5).position; // not over the top
  assert.ok(steep[1] > 10.9 && steep[2] > 0);
  assert.ok(formatView({ position: [-123456.78, -0.123456, 1e-9], target: [0, -0, 1], fov: 39.59 }).length < 64);
});
