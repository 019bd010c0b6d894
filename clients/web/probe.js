// The pixel probe: a click, a tap or the arrow keys choose a pixel, and the panel shows where its light comes from. probe_draw.js
// has the drawings, probe_words.js the texts.

import { colours, make, saveAs, setText } from './dom.js';
import { COLOURS, decodeSky, drawProbe } from './probe_draw.js';
import { Picker } from './probe_pick.js';
import { MINUTES, Trace, drawTrace } from './probe_plot.js';
import { RELATIVE, UNIT, countSamples, figure, percent, plotWords, rows, summary, sunGradient, sunWords } from './probe_words.js';

const AGAIN_MS = 1000; // between requests about a followed pixel
const LOST_MS = 15000; // an answer this late is lost; allows for large images

function toggle(id, label, checked) {
  const input = make('input', { type: 'checkbox', id, checked });
  return { input, row: make('label', { className: 'probe-toggle' }, input, ` ${label}`) };
}

class Probe {
  constructor(app) {
    this.app = app;
    this.request = 0;
    this.pixel = null; // the probed pixel
    this.answer = null;
    this.sky = null;
    this.waiting = 0; // the pending request; 0: none
    this.next = false; // repeat the request after that answer
    this.trace = new Trace();
    this.build(app.panel('probe', 'Where the light comes from'));
    this.picker = new Picker(app, (x, y) => this.choose(x, y));
    app.on('probed', (message) => this.take(message));
    app.on('radiance', (message) => this.takeRadiance(message));
    app.on('error', (error) => this.takeError(error));
    app.on('welcome', () => this.begin());
    app.waits.push(() => this.waitedMs());
    app.on('status', (status) => this.picker.setSize(status.width, status.height));
    setInterval(() => this.askAgain(), AGAIN_MS);
    setInterval(() => this.showTrace(), 250);
    new ResizeObserver(() => this.draw()).observe(this.latlong);
    document.addEventListener('visibilitychange', () => this.followIfSeen());
    window.relight.probe = this;
  }

  // ---- the panel

  build(body) {
    this.hint = make('p', { className: 'counts', id: 'probe-hint' });
    this.words = make('p', { className: 'probe-words', id: 'probe-words' });
    // Read out by screen readers: once per pixel instead of every second.
    this.spoken = make('p', { className: 'unseen probe-spoken', attributes: { role: 'status', 'aria-live': 'polite' } });
    this.shown = make('div', { id: 'probe-shown', hidden: true });
    this.latlong = this.canvas('probe-latlong', 'The sky as a lat-long image, with the samples');
    this.cross = this.canvas('probe-cross', 'The sky as a cross of six faces, with the samples');
    this.plot = this.canvas('probe-plot', 'Radiance over time');
    this.visibility = toggle('probe-visibility', 'Darken directions that are not visible', true);
    this.lobes = toggle('probe-lobes', 'Show BRDF samples', false);
    this.follow = toggle('probe-follow', 'Follow this pixel', true);
    this.samples = make('select', { id: 'probe-samples' },
      ...['', '16', '64', '256'].map((n) => make('option', { value: n, text: n || 'as in the image', selected: n === '64' })));
    this.preset = make('button', { type: 'button', id: 'probe-preset', text: 'As in Fig. 1', attributes: { 'aria-pressed': 'false' },
      title: '50 samples and a Phong exponent of 150, as Fig. 1 of Lu, Pacanowski and Granier 2013' });
    this.save = make('button', { type: 'button', id: 'probe-save', text: 'Save as JSON' });
    this.stop = make('button', { type: 'button', id: 'probe-stop', text: 'Stop' });
    this.legend = make('ul', { className: 'probe-legend', id: 'probe-legend' });
    this.shares = make('table', { className: 'probe-shares', id: 'probe-shares' });
    this.table = make('table', { className: 'probe-table', id: 'probe-table' });
    this.sunNow = make('span');
    this.sunBar = make('div', { className: 'probe-sun', attributes: { 'aria-hidden': 'true' } }, this.sunNow);
    this.sunText = make('p', { className: 'counts' });
    this.sun = make('div', { id: 'probe-sun', hidden: true }, make('h3', { text: 'Sun on this day' }), this.sunBar,
      make('div', { className: 'probe-hours', attributes: { 'aria-hidden': 'true' } },
        ...[0, 6, 12, 18, 24].map((hour) => make('span', { text: `${hour} h` }))), this.sunText);
    this.plotText = make('p', { className: 'counts', id: 'probe-plot-words' });
    this.shown.append(
      this.sun,
      make('div', { className: 'probe-row' }, this.preset,
        make('label', {}, 'Samples ', this.samples)),
      this.latlong, this.cross, this.legend, this.visibility.row, this.lobes.row,
      make('h3', { text: 'Samples per cube face' }), this.shares,
      make('h3', { text: 'This pixel' }), this.table,
      make('h3', { text: `Radiance in the last ${MINUTES} minutes` }), this.follow.row, this.plot, this.plotText,
      make('div', { className: 'probe-row' }, this.save, this.stop));
    body.append(this.hint, this.words, this.spoken, this.shown);
    this.listen();
    this.sayHint();
  }

  canvas(id, label) {
    return make('canvas', { id, attributes: { role: 'img', 'aria-label': label } });
  }

  listen() {
    for (const { input } of [this.visibility, this.lobes]) input.onchange = () => this.draw();
    this.samples.onchange = () => this.ask();
    this.follow.input.onchange = () => this.followIfSeen();
    this.save.onclick = () => this.download();
    this.stop.onclick = () => this.letGo();
    this.preset.onclick = () => {
      const on = this.preset.getAttribute('aria-pressed') !== 'true';
      this.preset.setAttribute('aria-pressed', String(on));
      this.samples.disabled = on;
      this.ask();
    };
  }

  sayHint() {
    this.hint.textContent = 'Click or tap the image, or press P and choose a pixel with the arrow keys and Enter.';
    this.hint.hidden = this.pixel !== null;
  }

  // ---- requests

  // A pixel was clicked, or Enter pressed.
  choose(x, y) {
    if (!this.pixel || this.pixel.x !== x || this.pixel.y !== y) this.trace.clear();
    this.pixel = this.app.pixel = { x, y };
    this.sayHint();
    this.ask();
    this.bringIn();
  }

  // In a narrow window the panel is far below the image, which stays at the top.
  bringIn() {
    const section = this.shown.closest('section');
    if (document.body.classList.contains('plain')) this.app.say('Press I to show the panel with the answer');
    section.querySelector('details').open = true;
    const stage = document.getElementById('stage');
    const sticky = getComputedStyle(stage).position === 'sticky' ? stage.offsetHeight : 0;
    section.style.scrollMarginTop = `${sticky}px`;
    if (section.getBoundingClientRect().top > window.innerHeight - 160) section.scrollIntoView({ block: 'start' });
  }

  // One request at a time, as the protocol requires.
  ask() {
    this.next = this.waiting !== 0;
    if (!this.pixel || this.next) return;
    this.request = Math.max(Date.now(), this.request + 1); // distinct from other parts' requests
    this.waiting = this.request;
    this.askedMs = performance.now();
    const message = { op: 'probe', request: this.request, ...this.pixel, sky: true, follow: this.follow.input.checked };
    if (this.preset.getAttribute('aria-pressed') === 'true') message.preset = 'fig1';
    else if (this.samples.value) message.samples = Number(this.samples.value);
    this.app.send(message);
  }

  // Repeated requests about a followed pixel are not urgent.
  waitedMs() {
    const answered = this.answer?.x === this.pixel?.x && this.answer?.y === this.pixel?.y;
    return this.waiting && !answered ? performance.now() - this.askedMs : 0;
  }

  // Repeats the request for a followed pixel, since its samples move with the sky.
  askAgain() {
    const seen = document.visibilityState === 'visible' && this.panelOpen();
    if (this.waiting && performance.now() - this.askedMs > LOST_MS) this.waiting = 0;
    const again = this.follow.input.checked && this.app.state.name === 'live';
    if (this.pixel && !this.waiting && seen && (again || this.next)) this.ask();
  }

  panelOpen() {
    return this.shown.closest('details')?.open !== false && !document.body.classList.contains('plain');
  }

  followIfSeen() {
    if (!this.pixel) return;
    if (this.follow.input.checked && document.visibilityState === 'visible') this.ask();
    else this.app.send({ op: 'probe', follow: false });
  }

  letGo() {
    this.app.send({ op: 'probe', follow: false });
    this.pixel = this.app.pixel = this.answer = null;
    this.next = false;
    this.trace.clear();
    this.shown.hidden = true;
    this.words.textContent = this.spoken.textContent = '';
    this.picker.mark(null);
    this.sayHint();
  }

  // A new connection must follow the pixel again.
  begin() {
    this.waiting = 0;
    this.ask();
  }

  // ---- answers

  async take(message) {
    if (message.request !== this.waiting) return;
    this.waiting = 0;
    const { op, request, ...answer } = message;
    if (this.next) this.ask();
    if (answer.x !== this.pixel?.x || answer.y !== this.pixel?.y) return;
    const first = this.answer?.x !== answer.x || this.answer?.y !== answer.y || this.answer?.preset !== answer.preset;
    this.answer = answer;
    this.sky = answer.sky ? await decodeSky(answer.sky) : this.sky;
    if (this.answer !== answer) return;
    this.shown.hidden = false;
    this.words.textContent = summary(answer);
    if (first) this.spoken.textContent = summary(answer);
    this.latlong.setAttribute('aria-label', `The sky as a lat-long image. ${summary(answer)}`);
    this.draw();
    this.showSun();
    this.showShares();
    this.showTable();
  }

  takeError(error) {
    if (error.code === 'unknown_op' && this.waiting) { // an older server
      this.letGo();
      this.waiting = 0;
      this.words.textContent = this.spoken.textContent = 'This server does not support the pixel probe.';
      return;
    }
    if (!error.clause?.startsWith('4.15') || (error.request && error.request !== this.waiting)) return;
    this.waiting = 0;
    if (error.code === 'busy') this.next = true; // askAgain repeats it
    this.words.textContent = error.code === 'busy' ? 'The server is busy with other requests; retrying.' : `No answer: ${error.message}.`;
    this.spoken.textContent = this.words.textContent;
  }

  takeRadiance({ x, y, radiance, frame, finer }) {
    if (x === this.pixel?.x && y === this.pixel?.y) this.trace.add(performance.now(), radiance, frame, finer);
  }

  // ---- drawing

  draw() {
    if (!this.answer || this.latlong.clientWidth === 0) return;
    const show = { visibility: this.visibility.input.checked, lobes: this.lobes.input.checked };
    drawProbe(this.latlong, 'latlong', this.answer, this.sky, show);
    drawProbe(this.cross, 'cross', this.answer, this.sky, show);
    this.showLegend(show.lobes);
  }

  showLegend(lobes) {
    const n = countSamples(this.answer);
    const items = [
      ['generated', `${n.generated - n.chosen} generated`],
      ['chosen', `${n.chosen - n.effective} chosen, but below the surface or without light`],
      ['blocked', `${n.effective - n.visible} effective, but blocked`],
      ['effective', `${n.visible} effective and unblocked: the larger, the more light`],
      ['normal', this.answer.point ? 'the normal' : 'the view direction'],
    ];
    if (lobes) items.push(['lobe', `${this.answer.lobes.length} BRDF samples`]);
    this.legend.replaceChildren(...items.map(([kind, text]) => {
      const sign = make('span', { className: `probe-sign ${kind}`, attributes: { 'aria-hidden': 'true' } });
      sign.style.setProperty('--colour', COLOURS[kind]);
      return make('li', {}, sign, text);
    }));
  }

  // Older servers, and skies whose sun's way is not known, say nothing.
  showSun() {
    const { sunlight } = this.answer;
    this.sun.hidden = !sunlight;
    if (!sunlight) return;
    this.sunBar.style.background = sunGradient(sunlight, 'var(--sun)', 'var(--shade)', 'var(--night)');
    this.sunNow.style.left = `${(100 * (this.app.status?.source?.hour ?? 0)) / 24}%`;
    setText(this.sunText, sunWords(sunlight));
  }

  showShares() {
    const head = ['Face', 'Share', 'Of the sky', 'Chosen', 'Unblocked'].map((text) => make('th', { text, scope: 'col' }));
    const body = this.answer.shares.map((s) => {
      const bar = make('span', { className: 'probe-bar', attributes: { 'aria-hidden': 'true' } });
      bar.style.width = `${(100 * s.share).toFixed(2)}%`;
      return make('tr', {},
        make('th', { text: s.face, scope: 'row' }),
        make('td', {}, percent(s.share), make('div', { className: 'probe-meter' }, bar)),
        make('td', { text: percent(s.energy) }),
        make('td', { text: `${s.chosen}\u00a0of\u00a0${s.generated}`, title: `N = ${figure(s.count)}` }),
        make('td', { text: String(s.visible) }));
    });
    this.shares.replaceChildren(
      make('caption', { text: 'Light samples by normal and sky (Eq. 3)' }),
      make('thead', {}, make('tr', {}, ...head)), make('tbody', {}, ...body));
    this.shares.hidden = body.length === 0;
  }

  // Only a weather file's light has units.
  get unit() {
    return this.app.status?.place?.units === 1 && !this.app.control?.scale_stops ? UNIT : RELATIVE;
  }

  showTable() {
    this.table.replaceChildren(make('tbody', {}, ...rows(this.answer, this.unit).map(([label, value, remark]) =>
      make('tr', {}, make('th', { text: label, scope: 'row' }),
        make('td', {}, value, remark ? make('small', { text: remark }) : '')))));
  }

  showTrace() {
    if (!this.answer || this.plot.clientWidth === 0 || document.visibilityState !== 'visible') return;
    const colour = colours();
    drawTrace(this.plot, this.trace.points, {
      rgb: [colour('--bad'), colour('--good'), colour('--sky')], line: colour('--line'), text: colour('--soft'),
    });
    const words = plotWords(this.trace.points, this.unit);
    setText(this.plotText, words);
    this.plot.setAttribute('aria-label', words);
  }

  download() {
    const { answer } = this;
    if (!answer) return;
    const text = JSON.stringify({ ...answer, over_time: this.trace.points }, null, 1);
    saveAs(new Blob([text], { type: 'application/json' }), `probe_${answer.x}_${answer.y}_frame_${answer.frame}.json`);
  }
}

export function mount(app) {
  document.head.append(make('link', { rel: 'stylesheet', href: 'probe.css' }));
  return new Probe(app);
}
