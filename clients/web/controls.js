// The controls: settings that a controller changes for all viewers. This file has the panel, controls_time.js the timeline. The
// controls show the server's current settings, overlaid with the user's newest changes.

import {
  LAMPS, NOISES, RATES, SAMPLES, Wishes, changesText, degreesText, errorOf, lampsOf, lampsText, next, noiseOf, noiseText,
  stopsOfLamps, stopsText, withPresent, wrapDegrees,
} from './controls_model.js';
import { turnByDragging } from './controls_drag.js';
import { orbitByDragging, isFreeView } from './controls_orbit.js';
import { Transport } from './controls_time.js';
import { make, setOptions, setValue } from './dom.js';

class Controls {
  constructor(app) {
    this.app = app;
    this.wishes = new Wishes((message) => app.send(message));
    this.gain = null;
    this.there = false; // welcomed, and still connected
    this.build(app.panel('controls', 'Controls'));
    this.transport = new Transport(this);
    turnByDragging(app.canvas, this);
    this.orbit = orbitByDragging(app.canvas, this);
    this.keys();
    app.on('welcome', (welcome) => this.begin(welcome));
    app.on('control', (control) => this.take(control));
    app.on('status', () => this.show());
    app.on('state', ({ name }) => {
      if (name === 'reconnecting' || name === 'refused') this.there = false;
      this.show();
    });
    app.on('error', (error) => this.refused(error));
    app.on('picture', ({ header }) => { this.gain = header.gain; });
    app.waits.push(() => this.wishes.waitedMs);
    this.show();
  }

  // ---- permissions

  // Whether the server accepted us as a controller; a server of minor version 0 has no settings.
  get may() {
    return this.there && this.app.role === 'controller' && this.app.control !== null;
  }

  // The current settings, overlaid with our changes.
  get now() {
    return this.wishes.over(this.app.control ?? {});
  }

  get offers() {
    return this.app.status?.offers ?? {};
  }

  // A setting's range, as the server tells it.
  limits(field) {
    return { least: -Infinity, most: Infinity, ...this.app.welcome?.controls?.[field] };
  }

  within(field, values) {
    const { least, most } = this.limits(field);
    return values.filter((value) => value >= least && value <= most);
  }

  // What the server says about the light in the image.
  pathsText(name) {
    return this.app.welcome?.controls?.paths?.choices[name] ?? name;
  }

  ask(wish) {
    if (!this.may) {
      this.app.say(this.there ? 'Only a controller can change this.' : 'Not connected to the server.');
      return;
    }
    this.wishes.ask(wish);
    this.show();
  }

  begin(welcome) {
    this.id = welcome.id;
    this.there = true;
    this.before = null;
    this.wishes.forget();
    this.show();
  }

  take(control) {
    const { before } = this;
    this.before = control;
    if (control.by === this.id) this.wishes.answered(control.request);
    else if (before && control.by !== '0') {
      const changes = changesText(before, control);
      if (changes) this.app.say(`Another controller changed ${changes}.`);
    }
    this.show();
  }

  refused(error) {
    if (!String(error.clause).startsWith('4.13')) return;
    this.app.say(`Refused: ${error.message}.`);
    this.wishes.answered(error.request);
    this.show();
  }

  // ---- the panel

  build(body) {
    this.why = make('p', { id: 'controls-why', className: 'soft' });
    this.camera = this.choice('set-camera', 'Camera', (camera) => ({ camera }));
    this.forget = make('button', { id: 'forget-view', type: 'button', text: 'Forget this view', hidden: true });
    this.forget.onclick = () => this.forgetView();
    this.preparing = make('progress', { id: 'camera-progress', max: 1, hidden: true });
    this.preparing.setAttribute('aria-label', 'Preparing this camera\u2019s view');
    this.rotate = this.range('set-rotate', 'Rotate the sky', -180, 180, 1, (v) => ({ rotate_degrees: v }));
    this.lamps = this.range('set-lamps', 'Lamps', LAMPS.least, LAMPS.most, 0.25, (v) => ({ lamps: lampsOf(v) }));
    this.exposureMode = this.choice('exposure-mode', 'Exposure', (mode) => this.exposureWish(mode));
    this.exposure = this.range('set-exposure', 'Exposure', -10, 10, 0.1,
      (v) => (this.exposureIsFixed ? { exposure_stops: v } : { bias_stops: v }));
    this.tone = this.choice('set-tone', 'Tone curve', (tone) => ({ tone }));
    this.paths = this.choice('set-paths', 'Light', (paths) => ({ paths }));
    this.method = this.choice('set-method', 'Method', (method) => ({ method }));
    this.effort = this.choice('set-effort', 'Quality', (value) => this.effortWish(value));
    this.fps = this.choice('set-fps', 'Frame rate limit', (value) => ({ fps: Number(value) }));
    this.fields = make('fieldset', { id: 'controls-fields' },
      make('legend', { className: 'unseen', text: 'Settings for all viewers' }),
      this.camera.row, this.forget, this.preparing, this.rotate.row, this.lamps.row,
      this.exposureMode.row, this.exposure.row, this.tone.row, this.paths.row, this.method.row, this.effort.row, this.fps.row);
    body.append(this.why, this.fields);
  }

  choice(id, label, wish) {
    const select = make('select', { id });
    select.onchange = () => this.ask(wish(select.value));
    return { select, row: make('div', { className: 'control' }, make('label', { text: label, htmlFor: id }), select) };
  }

  range(id, label, min, max, step, wish) {
    const input = make('input', { type: 'range', id, min, max, step });
    const output = make('output', { htmlFor: id, id: `${id}-text` });
    const name = make('label', { text: label, htmlFor: id });
    input.oninput = () => this.ask(wish(Number(input.value)));
    return { input, output, name, row: make('div', { className: 'control wide' }, name, output, input) };
  }

  get exposureIsFixed() {
    return typeof this.now.exposure_stops === 'number';
  }

  // 'fixed' keeps the image's current gain, without a jump; the other modes are the server's.
  exposureWish(mode) {
    const stops = this.gain > 0 ? Math.log2(this.gain) : 0;
    if (mode === 'fixed') return { exposure_stops: Number(stops.toFixed(2)) };
    return { exposure_stops: mode === 'follow' ? null : mode, bias_stops: 0 };
  }

  effortWish(value) {
    if (value === 'time') return this.now.error ? { error: null } : { samples: null };
    const [kind, number] = value.split(' ');
    return kind === 'samples' ? { samples: Number(number) } : { error: errorOf(Number(number)) };
  }

  get effortNow() {
    const { error, counted, samples } = this.now;
    if (error > 0) return `noise ${Number(noiseOf(error).toPrecision(3))}`;
    if (this.wishes.waiting?.samples === null || this.wishes.underway?.samples === null) return 'time';
    return counted || samples !== this.app.control?.samples ? `samples ${samples}` : 'time';
  }

  // Choices of method auto; other methods offer sample counts only.
  efforts() {
    const { method } = this.now;
    const [kind, number] = this.effortNow.split(' ');
    const noises = withPresent(NOISES, kind === 'noise' ? Number(number) : undefined);
    const samples = withPresent(this.within('samples', SAMPLES), kind === 'samples' ? Number(number) : undefined);
    const counted = samples.map((n) => [`samples ${n}`, `${n} ${n === 1 ? 'sample' : 'samples'} per point`]);
    if (method !== 'auto') return counted;
    return [['time', 'as time allows'], ...noises.map((n) => [`noise ${n}`, `noise ${noiseText(n)}`]), ...counted];
  }

  // ---- showing

  whyNot() {
    const { app } = this;
    if (this.may || !app.welcome) return '';
    if (!this.there) return 'Not connected to the server; these are the last known settings.';
    if (app.role === 'controller') return 'This server has no settings to control.';
    return app.welcome.roles?.includes('controller')
      ? 'You are watching. To change settings, open this page with #role=controller at the end of the address, and &token=\u2026 if the server requires one.'
      : 'You are watching; this server accepts no controllers.';
  }

  show() {
    const { now, offers, app } = this;
    const why = this.whyNot();
    this.why.textContent = why;
    this.why.hidden = !why;
    this.fields.disabled = !this.may;
    this.fields.hidden = app.control === null;
    this.showRole();
    this.transport.show();
    if (app.control === null) return;
    this.showCamera();
    setValue(this.rotate.input, wrapDegrees(now.rotate_degrees));
    this.tell(this.rotate, degreesText(now.rotate_degrees));
    this.showLamps();
    this.showExposure();
    setOptions(this.tone.select, (offers.tones ?? [now.tone]).map((t) => [t, t]), now.tone);
    setOptions(this.paths.select, withPresent(offers.paths ?? [], now.paths).map((p) => [p, this.pathsText(p)]), now.paths);
    this.firstMethod ??= now.method; // the command line's may not be on offer, such as components
    const methods = withPresent(withPresent(offers.methods ?? [], this.firstMethod), now.method);
    setOptions(this.method.select, methods.map((m) => [m, m]), now.method);
    setOptions(this.effort.select, this.efforts(), this.effortNow);
    setOptions(this.fps.select, withPresent(this.within('fps', RATES), now.fps).map((r) => [String(r), String(r)]), String(now.fps));
  }

  tell(range, text) {
    range.output.textContent = text;
    range.input.setAttribute('aria-valuetext', text);
  }

  showRole() {
    const pill = document.getElementById('role');
    pill.hidden = !this.there;
    pill.textContent = this.may ? 'Controlling' : 'Watching';
    const touch = window.matchMedia('(pointer: coarse)').matches; // no mouse, and probably no keyboard
    const click = touch ? 'tap' : 'click';
    const move = touch ? 'with two fingers to move the camera' : 'with Alt to move the camera';
    const what = this.may ? `Drag across the image to rotate the sky, ${move}; ${click} it` : `${click[0].toUpperCase()}${click.slice(1)} the image`;
    const more = touch ? 'press ? above for help' : 'press ? for all keys';
    document.getElementById('hint').textContent = `${what} to see where a pixel\u2019s light comes from; ${more}.`;
  }

  showCamera() {
    const cameras = this.offers.cameras ?? [];
    const { preparing } = this.app.status ?? {};
    const free = isFreeView(this.now.camera);
    this.camera.row.hidden = cameras.length < 2 && !free;
    setOptions(this.camera.select, [...cameras.map((c) => [c, c]), ...(free ? [[this.now.camera, 'free view']] : [])], this.now.camera);
    this.forget.hidden = !this.may || !this.isSaved;
    this.preparing.hidden = !preparing;
    if (preparing) this.preparing.value = preparing.share;
  }

  // Only a scene with lamps of its own has the slider. While their light is computed it says how far.
  showLamps() {
    const { lamps } = this.app.status ?? {};
    const { lamps: factor } = this.now;
    this.lamps.row.hidden = !lamps || factor === undefined;
    if (this.lamps.row.hidden) return;
    const share = factor > 0 && lamps.samples < lamps.wanted ? `, ${Math.floor((100 * lamps.samples) / lamps.wanted)} % computed` : '';
    setValue(this.lamps.input, stopsOfLamps(factor));
    this.tell(this.lamps, `${lampsText(factor)}${share}`);
  }

  showExposure() {
    const { now } = this;
    const fixed = this.exposureIsFixed;
    const stops = fixed ? now.exposure_stops : now.bias_stops;
    const modes = [...(this.offers.exposures ?? ['follow']), 'fixed'];
    setOptions(this.exposureMode.select, modes.map((m) => [m, m]), fixed ? 'fixed' : now.exposure_stops ?? 'follow');
    this.exposureMode.row.hidden = this.exposure.row.hidden = now.exposure_stops === undefined;
    this.exposure.name.textContent = fixed ? 'Exposure value' : 'Exposure compensation';
    // Centre the range on the current value: scales of skies differ by a factor of thousands.
    const centre = fixed ? 10 * Math.round(stops / 10) : 0;
    const half = fixed ? 10 : 20;
    const { least, most } = this.limits(fixed ? 'exposure_stops' : 'bias_stops');
    this.exposure.input.min = Math.max(least, centre - half);
    this.exposure.input.max = Math.min(most, centre + half);
    setValue(this.exposure.input, stops);
    this.tell(this.exposure, stopsText(stops));
  }

  // ---- keys

  keys() {
    const { app } = this;
    const turn = (by) => () => this.askAndSay({ rotate_degrees: wrapDegrees((this.now.rotate_degrees ?? 0) + by) },
      () => `Sky rotated by ${degreesText(this.now.rotate_degrees)}`);
    app.key('[', 'Rotate the sky to the right', turn(-5));
    app.key(']', 'Rotate the sky to the left', turn(5));
    app.key(['+', '='], 'Brighter', () => this.brighten(0.5));
    app.key('-', 'Darker', () => this.brighten(-0.5));
    app.key('a', 'Fixed exposure on or off', () => {
      this.ask(this.exposureWish(this.exposureIsFixed ? 'follow' : 'fixed'));
      this.sayIfMay(this.exposureIsFixed ? 'Fixed exposure' : 'Exposure follows the images');
    });
    this.cycle('t', 'Next tone curve', 'tone', () => this.offers.tones, 'Tone curve');
    this.cycle('l', 'Direct light only, or all light', 'paths', () => this.offers.paths, 'Light', (p) => this.pathsText(p));
    this.cycle('m', 'Next method', 'method', () => this.offers.methods, 'Method');
    this.cycle('c', 'Next camera', 'camera', () => this.offers.cameras, 'Camera');
    const move = (dx, dy, zoom) => () => {
      if (this.orbit(dx, dy, zoom)) this.app.say('Camera moved');
      else if (!this.may) this.ask({}); // which says why
    };
    app.key('q', 'Camera to the left (or Alt and drag, or two fingers)', move(1 / 36, 0));
    app.key('e', 'Camera to the right', move(-1 / 36, 0));
    app.key('u', 'Camera up', move(0, 1 / 36));
    app.key('n', 'Camera down', move(0, -1 / 36));
    app.key('z', 'Camera nearer (or Alt and wheel, or pinch)', move(0, 0, 0.9));
    app.key('Shift+z', 'Camera farther', move(0, 0, 1 / 0.9));
    app.key('v', 'Save the view under a name', () => this.saveView());
    app.key('Shift+v', 'Forget the saved view that is shown', () => this.forgetView());
    this.cycle('r', 'Next frame rate limit', 'fps', () => this.within('fps', RATES), 'Frame rate limit');
    app.key('g', 'Next quality', () => this.nextEffort(1));
    app.key('Shift+g', 'Previous quality', () => this.nextEffort(-1));
  }

  saveView() {
    const name = this.may ? window.prompt('Save this view as', '')?.trim() : '';
    if (name !== undefined && (name || !this.may)) this.askAndSay({ save_view: name }, () => `Saved ${name} among the cameras`);
  }

  get isSaved() {
    return Boolean(this.offers.views?.includes(this.now.camera));
  }

  // What is shown stays, as a free view: a saved one cannot be forgotten while it is the camera.
  forgetView() {
    const { camera } = this.now;
    if (this.may && !this.isSaved) this.app.say('No saved view is shown');
    else this.askAndSay({ camera: this.app.status.view, forget_view: camera }, () => `Forgot ${camera}`);
  }

  sayIfMay(text) {
    if (this.may) this.app.say(text);
  }

  askAndSay(wish, text) {
    this.ask(wish);
    this.sayIfMay(text());
  }

  brighten(by) {
    const field = this.exposureIsFixed ? 'exposure_stops' : 'bias_stops';
    const { least, most } = this.limits(field);
    const stops = Math.max(least, Math.min(most, (this.now[field] ?? 0) + by));
    this.askAndSay({ [field]: stops },
      () => `Exposure ${stopsText(stops)}`);
  }

  cycle(key, label, field, choices, name, text = String) {
    this.app.key(key, label, () => {
      const all = choices() ?? [];
      if (all.length < 2 && this.may) return;
      const value = next(all, this.now[field]);
      this.askAndSay({ [field]: value }, () => `${name}: ${text(value)}`);
    });
  }

  nextEffort(by) {
    const all = this.efforts();
    const value = next(all.map(([v]) => v), this.effortNow, by);
    this.askAndSay(this.effortWish(value), () => `Quality: ${all.find(([v]) => v === value)[1]}`);
  }
}

export function mount(app) {
  const controls = new Controls(app);
  window.relight.controls = controls;
}
