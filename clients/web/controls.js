// The controls: what a controller changes for all who watch. The panel here, time below the picture in controls_time.js;
// what is shown is always what the server says is in force, with one's own newest wishes on top.

import {
  NOISES, RATES, SAMPLES, Wishes, changesText, degreesText, errorOf, next, noiseOf, noiseText, stopsText, withPresent,
  wrapDegrees,
} from './controls_model.js';
import { turnByDragging } from './controls_drag.js';
import { Transport } from './controls_time.js';
import { make, setOptions, setValue } from './dom.js';

const PATHS = { direct: 'direct light only', all: 'all light' };

class Controls {
  constructor(app) {
    this.app = app;
    this.wishes = new Wishes((message) => app.send(message));
    this.gain = null;
    this.there = false; // the server has welcomed us, and has not been lost since
    this.build(app.panel('controls', 'Controls'));
    this.transport = new Transport(this);
    turnByDragging(app.canvas, this);
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

  // ---- who may

  // The role that the server took us in; a server of minor 0 tells nothing that could be set.
  get may() {
    return this.there && this.app.role === 'controller' && this.app.control !== null;
  }

  // What is in force with our wishes on top.
  get now() {
    return this.wishes.over(this.app.control ?? {});
  }

  get offers() {
    return this.app.status?.offers ?? {};
  }

  ask(wish) {
    if (!this.may) {
      this.app.say(this.there ? 'Only a controller can change that.' : 'The server is not connected.');
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
      if (changes) this.app.say(`Another controller has set ${changes}.`);
    }
    this.show();
  }

  refused(error) {
    if (!String(error.clause).startsWith('4.13')) return;
    this.app.say(`Not done: ${error.message}.`);
    this.wishes.answered(error.request);
    this.show();
  }

  // ---- the panel

  build(body) {
    this.why = make('p', { id: 'controls-why', className: 'soft' });
    this.camera = this.choice('set-camera', 'Camera', (camera) => ({ camera }));
    this.preparing = make('progress', { id: 'camera-progress', max: 1, hidden: true });
    this.preparing.setAttribute('aria-label', 'The view of that camera is being computed');
    this.rotate = this.range('set-rotate', 'Turn of the sky', -180, 180, 1, (v) => ({ rotate_degrees: v }));
    this.automatic = make('input', { type: 'checkbox', id: 'exposure-auto' });
    this.automatic.onchange = () => this.setAutomatic(this.automatic.checked);
    this.exposure = this.range('set-exposure', 'Exposure', -10, 10, 0.1,
      (v) => (this.now.exposure_stops === null ? { bias_stops: v } : { exposure_stops: v }));
    this.tone = this.choice('set-tone', 'Tone curve', (tone) => ({ tone }));
    this.paths = this.choice('set-paths', 'Light', (paths) => ({ paths }));
    this.method = this.choice('set-method', 'Method', (method) => ({ method }));
    this.effort = this.choice('set-effort', 'Good enough', (value) => this.effortWish(value));
    this.fps = this.choice('set-fps', 'Pictures/s, at most', (value) => ({ fps: Number(value) }));
    this.fields = make('fieldset', { id: 'controls-fields' },
      make('legend', { className: 'unseen', text: 'What is shown to all who watch' }),
      this.camera.row, this.preparing, this.rotate.row,
      make('div', { className: 'control' },
        make('label', { className: 'check' }, this.automatic, ' Exposure follows the picture')),
      this.exposure.row, this.tone.row, this.paths.row, this.method.row, this.effort.row, this.fps.row);
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

  // From one to the other without a jump: fixed at the gain that the picture has, or back.
  setAutomatic(on) {
    const stops = this.gain > 0 ? Math.log2(this.gain) : 0;
    this.ask(on ? { exposure_stops: null, bias_stops: 0 } : { exposure_stops: Number(stops.toFixed(2)) });
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

  // What method auto takes; the others only count.
  efforts() {
    const { method } = this.now;
    const [kind, number] = this.effortNow.split(' ');
    const noises = withPresent(NOISES, kind === 'noise' ? Number(number) : undefined);
    const samples = withPresent(SAMPLES, kind === 'samples' ? Number(number) : undefined);
    const counted = samples.map((n) => [`samples ${n}`, `${n} ${n === 1 ? 'sample' : 'samples'} a point`]);
    if (method !== 'auto') return counted;
    return [['time', 'as time allows'], ...noises.map((n) => [`noise ${n}`, `noise of ${noiseText(n)}`]), ...counted];
  }

  // ---- showing

  whyNot() {
    const { app } = this;
    if (this.may || !app.welcome) return '';
    if (!this.there) return 'The server is not connected; this is what was in force.';
    if (app.role === 'controller') return 'This server has nothing to control.';
    return app.welcome.roles?.includes('controller')
      ? 'You are watching. A controller\u2019s page changes what is shown here: its address ends in #role=controller, with &token=\u2026 where the server asks for one.'
      : 'You are watching; this server takes no controllers.';
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
    this.showExposure();
    setOptions(this.tone.select, (offers.tones ?? [now.tone]).map((t) => [t, t]), now.tone);
    setOptions(this.paths.select, withPresent(offers.paths ?? [], now.paths).map((p) => [p, PATHS[p] ?? p]), now.paths);
    setOptions(this.method.select, (offers.methods ?? [now.method]).map((m) => [m, m]), now.method);
    setOptions(this.effort.select, this.efforts(), this.effortNow);
    setOptions(this.fps.select, withPresent(RATES, now.fps).map((r) => [String(r), String(r)]), String(now.fps));
  }

  tell(range, text) {
    range.output.textContent = text;
    range.input.setAttribute('aria-valuetext', text);
  }

  showRole() {
    const pill = document.getElementById('role');
    pill.hidden = !this.there;
    pill.textContent = this.may ? 'Controlling' : 'Watching';
    const touch = window.matchMedia('(pointer: coarse)').matches; // no mouse, and likely no keys
    const click = touch ? 'tap' : 'click';
    const what = this.may ? `Drag across the picture to turn the sky; ${click} it` : `${click[0].toUpperCase()}${click.slice(1)} the picture`;
    const more = touch ? 'the ? above says more' : 'press ? for all keys';
    document.getElementById('hint').textContent = `${what} to see where a pixel\u2019s light comes from; ${more}.`;
  }

  showCamera() {
    const cameras = this.offers.cameras ?? [];
    const { preparing } = this.app.status ?? {};
    this.camera.row.hidden = cameras.length < 2;
    setOptions(this.camera.select, cameras.map((c) => [c, c]), this.now.camera);
    this.preparing.hidden = !preparing;
    if (preparing) this.preparing.value = preparing.share;
  }

  showExposure() {
    const { now } = this;
    const follows = now.exposure_stops === null;
    const stops = follows ? now.bias_stops : now.exposure_stops;
    this.automatic.checked = follows;
    this.exposure.row.hidden = now.exposure_stops === undefined;
    this.exposure.name.textContent = follows ? 'Brighter or darker than that' : 'Exposure';
    // Around what is in force, since scales of skies differ by thousands.
    const centre = follows ? 0 : 10 * Math.round(stops / 10);
    this.exposure.input.min = centre - 10;
    this.exposure.input.max = centre + 10;
    setValue(this.exposure.input, stops);
    this.tell(this.exposure, stopsText(stops));
  }

  // ---- keys

  keys() {
    const { app } = this;
    const turn = (by) => () => this.askAndSay({ rotate_degrees: wrapDegrees((this.now.rotate_degrees ?? 0) + by) },
      () => `Sky turned by ${degreesText(this.now.rotate_degrees)}`);
    app.key('[', 'Turn the sky to the right', turn(-5));
    app.key(']', 'Turn the sky to the left', turn(5));
    app.key(['+', '='], 'Brighter', () => this.brighten(0.5));
    app.key('-', 'Darker', () => this.brighten(-0.5));
    app.key('a', 'Exposure: follow the picture, or stay fixed', () => {
      this.setAutomatic(this.now.exposure_stops !== null);
      this.sayIfMay(this.now.exposure_stops === null ? 'Exposure follows the picture' : 'Exposure is fixed');
    });
    this.cycle('t', 'Next tone curve', 'tone', () => this.offers.tones, 'Tone curve');
    this.cycle('l', 'Direct light only, or all light', 'paths', () => this.offers.paths, 'Light', (p) => PATHS[p] ?? p);
    this.cycle('m', 'Next method', 'method', () => this.offers.methods, 'Method');
    this.cycle('c', 'Next camera', 'camera', () => this.offers.cameras, 'Camera');
    this.cycle('r', 'Next limit of pictures per second', 'fps', () => RATES, 'Pictures per second, at most');
    app.key('g', 'Good enough: next', () => this.nextEffort(1));
    app.key('Shift+g', 'Good enough: the one before', () => this.nextEffort(-1));
  }

  sayIfMay(text) {
    if (this.may) this.app.say(text);
  }

  askAndSay(wish, text) {
    this.ask(wish);
    this.sayIfMay(text());
  }

  brighten(by) {
    const { exposure_stops: fixed, bias_stops: bias } = this.now;
    const stops = (fixed ?? bias ?? 0) + by;
    this.askAndSay(fixed === null ? { bias_stops: Math.max(-10, Math.min(10, stops)) } : { exposure_stops: stops },
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
    this.askAndSay(this.effortWish(value), () => `Good enough: ${all.find(([v]) => v === value)[1]}`);
  }
}

export function mount(app) {
  const controls = new Controls(app);
  window.relight.controls = controls;
}
