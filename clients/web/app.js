// The page: shows states and statistics, and gives each panel's module its hooks. player.js and below handle the connection.

import { FLAG_FINER, FLAG_REPEAT, PICTURE_BYTES } from './js/protocol.js';
import { setText as setTextOf, withKey } from './dom.js';
import { Rate, Recent } from './figures.js';
import { showHelp } from './help.js';
import { STAGES, latencyParts } from './insight_model.js';
import { Keys, keyOf } from './keys.js';
import { makePanel } from './panels.js';
import { keepAccess, wishedHls, wishedPictures, wishedRole } from './role.js';
import { Screen } from './screen.js';
import { startPlayer, watchPage } from './start.js';
import {
  bitsPerSecond, codingSentence, describe, lightSentence, milliseconds, Pace, publishSentence, stateSentence, stateWord, sunSentence,
  withoutFolders,
} from './sentences.js';
import { startTheme, switchTheme } from './theme.js';

// Independent panels and tools, each with `export function mount(app)`. A failing one does not affect the others.
const MODULES = ['./controls.js', './probe.js', './snapshot.js', './compare.js', './insight.js', './changes.js', './sky_panel.js', './daylight.js'];

const $ = (id) => document.getElementById(id);

const byHls = wishedHls(location); // hls.js instead of the player

const relight = {
  state: { name: 'connecting' },
  frames: 0, // images drawn
  lastHeader: null,
  status: null,
  latencyMs: NaN,
  noVideo: null, // why there is no H.264, once known
  videoAgain: false, // it will be tried again
  readback: () => screen.readback(),
};
window.relight = relight;

// The interface for modules.
const listeners = new Map();
const keys = new Keys();
const pace = new Pace(); // of the light-transport cache
const app = {
  canvas: $('picture'),
  state: relight.state,
  status: null, // the latest of each
  welcome: null,
  role: null, // granted by the server: 'viewer' or 'controller'
  control: null,
  pixel: null, // the probed pixel
  // Events: 'state', 'welcome' and 'status' with the server's message; 'picture' after it was drawn, with {header, clock,
  // heardMs, decodeMs, bytes, nowMs}; 'error' with the server's error message; any other server message by its op, such as
  // 'control' or 'probed'.
  on(name, then) {
    if (!listeners.has(name)) listeners.set(name, []);
    listeners.get(name).push(then);
  },
  // Sends a JSON message to the server; dropped before welcome.
  send: (message) => send({ op: 'say', message }),
  // app.key('f', 'Full screen', act), app.key(['ArrowLeft', ','], ..): a page-wide key, listed in help.
  key: (key, label, act) => keys.add(key, label, act),
  get rows() { return keys.rows.length; }, // how many keys help lists
  // Shows <section id=ID> with this heading and returns its body; {open: false}: initially folded.
  panel: makePanel,
  // Shows a short message for a moment.
  say,
  // Functions that return how many ms the user has been waiting for the server; 0: not waiting.
  waits: [],
};
relight.app = app;

function emit(name, value) {
  for (const then of listeners.get(name) ?? []) {
    try {
      then(value);
    } catch (error) {
      console.error(error); // do not affect other panels
    }
  }
}

let sayTimer;
function say(text) {
  setText('toast', text);
  clearTimeout(sayTimer);
  sayTimer = setTimeout(() => setText('toast', ''), 2500);
}

// The server answers between two images, each of which may take seconds: tell a waiting user why.
const WAIT_MS = 400;
const LOST_MS = 60000; // such an answer is lost
const WAIT_TEXT = 'Waiting for the server to finish the current image';

function showWaits() {
  const there = ['live', 'stalled', 'paused', 'ended'].includes(relight.state.name);
  const waited = app.waits.map((wait) => wait()).some((ms) => ms > WAIT_MS && ms < LOST_MS);
  if (there && waited) say(WAIT_TEXT);
  else if ($('toast').textContent === WAIT_TEXT) say('');
}

const figures = {
  drawn: new Rate(),
  arrived: new Rate(),
  latency: new Recent(),
  stages: Object.fromEntries(STAGES.map(([key]) => [key, new Recent(30)])),
  clock: { known: false },
};

// ---- the player

let send = () => {};

function take(event) {
  switch (event.op) {
    case 'state': showState(event.state); break;
    case 'welcome': takeWelcome(event.welcome, event.role); break;
    case 'status': takeStatus(event.status, event.clock); break;
    case 'picture': takePicture(event); break;
    case 'error': takeError(event.error); break;
    case 'heard': takeOther(event.message); break;
    case 'coding':
      relight.noVideo = event.reason;
      relight.videoAgain = event.again;
      break;
    case 'undecodable': console.warn(`picture ${event.sequence} could not be decoded: ${event.reason}`); break;
    default: break;
  }
}

function takeWelcome(welcome, role) {
  forgetFigures();
  app.welcome = welcome;
  app.role = role;
  if (typed) keepAccess({ token: typed, role });
  app.control = null;
  emit('welcome', welcome);
}

function takeError(error) {
  console.warn(`relightd: ${error.message} (clause ${error.clause})`);
  emit('error', error);
}

function takeOther(message) {
  if (message.op === 'control') app.control = message;
  emit(message.op, message);
}

// ---- images

const screen = new Screen($('picture'), drawn);

function takePicture(picture) {
  figures.arrived.add(performance.now(), PICTURE_BYTES + picture.bytes);
  figures.clock = picture.clock;
  screen.show(picture);
}

function drawn(picture, nowMs) {
  const { header } = picture;
  send({ op: 'displayed', sequence: header.sequence, nowMs });
  relight.frames++;
  relight.lastHeader = header;
  document.body.classList.add('seen');
  if (!(header.flags & FLAG_REPEAT)) figures.drawn.add(performance.now());

  if (!(header.flags & FLAG_FINER)) measure(picture, nowMs); // refinements of a still sky would count its age as latency
  if (relight.frames === 1) showState(relight.state);
  const { bitmap, ...rest } = picture; // closed by now
  emit('picture', { ...rest, nowMs });
}

function measure(picture, nowMs) {
  const { header } = picture;
  const serverUs = header.queuedUs + header.decodedUs + header.shadedUs + header.encodedUs;
  const shownUs = picture.clock.known && !(header.flags & FLAG_REPEAT) ? nowMs * 1000 + picture.clock.offsetUs : NaN;
  latencyParts(header, shownUs).forEach((ms, i) => { if (Number.isFinite(ms)) figures.stages[STAGES[i][0]].add(ms); });
  if (Number.isFinite(shownUs)) {
    const bornUs = header.captureUs || header.publishedUs - serverUs;
    figures.latency.add(Math.max(0, shownUs - bornUs) / 1000);
    relight.latencyMs = figures.latency.median();
  }
}

function forgetFigures() {
  figures.latency.clear();
  for (const [key] of STAGES) figures.stages[key].clear();
}

// ---- status and state

function takeStatus(status, clock) {
  relight.status = app.status = status;
  figures.clock = clock;
  setText('about', describe(status));
  $('picture').setAttribute('aria-label', describe(status));
  setText('sun-text', sunSentence(status.light, Boolean(status.place)));
  showSun(status.light?.sun);
  emit('status', status);
}

// The token that the user has typed; the field appears when the server needs one.
let typed;

function showAccess(state) {
  const wasHidden = $('access').hidden;
  $('access').hidden = !state.token;
  setText('access-note', state.token && typed ? 'The server does not accept this token.' : '');
  if (state.token && wasHidden) $('token').focus();
}

function useToken(event) {
  event.preventDefault();
  typed = $('token').value.trim();
  if (typed) send({ op: 'token', token: typed });
}

const setText = (id, text) => setTextOf($(id), text);

function showState(state) {
  const seen = relight.frames > 0;
  relight.state = app.state = state;
  document.body.dataset.state = state.name;
  setText('state-word', stateWord(state));
  setText('sentence', stateSentence(state, seen));
  setText('veil-sentence', stateSentence(state, seen));
  showCountdown();
  const stuck = state.name === 'reconnecting' || state.name === 'refused';
  for (const button of document.querySelectorAll('.again')) button.hidden = !stuck || Boolean(state.token);
  showAccess(state);
  emit('state', state);
}

function showCountdown() {
  const { untilMs } = relight.state;
  const left = untilMs ? Math.max(0, Math.ceil((untilMs - performance.timeOrigin - performance.now()) / 1000)) : null;
  const text = left === null ? '' : left > 0 ? ` in ${left} s.` : ' now.';
  document.querySelectorAll('.countdown').forEach((element) => setTextOf(element, text));
}

// The sky as a semicircle with the sun at its elevation; it rises on the left.
function showSun(sun) {
  $('sky').toggleAttribute('hidden', !sun); // an SVG element has no property of that name
  if (!sun) return;
  const up = (sun.elevation * Math.PI) / 180;
  // Looking south: azimuth 90 (east) is left, 270 (west) right.
  const across = Math.sin(((sun.azimuth - 180) * Math.PI) / 180) * Math.cos(up);
  $('sun').setAttribute('cx', (50 + 40 * across).toFixed(1));
  $('sun').setAttribute('cy', (46 - 40 * Math.sin(up)).toFixed(1));
  $('sky').classList.toggle('night', sun.elevation < -0.8);
}

function showFigures() {
  const now = performance.now();
  const { clock, stages } = figures;
  const status = relight.status;
  const fps = figures.drawn.perSecond(now);
  setText('fps', relight.frames ? fps.toFixed(fps < 9.95 ? 1 : 0) : '–');
  setText('latency', milliseconds(figures.latency.median()));
  setText('round-trip', clock.known ? `${milliseconds(clock.rttUs / 1000)}` : '–');
  setText('clock', clock.known ? `± ${milliseconds(clock.uncertaintyUs / 1000)}` : '');
  setText('frame', relight.lastHeader ? String(relight.lastHeader.frame) : '–');
  setText('traffic', bitsPerSecond(figures.arrived.bytesPerSecond(now)));
  setText('coding', codingSentence(relight.lastHeader?.format, relight.noVideo, relight.videoAgain));
  if (status) {
    const { used, dropped, refused, last_refusal: last } = status.frames;
    setText('used', String(used));
    setText('lost', `${dropped} dropped, ${refused} refused`);
    setText('refusal', last ? `Last refused: ${withoutFolders(last)}` : '');
    setText('skipped', String(status.skipped));
    setText('viewers', String(status.viewers));
    setText('light', lightSentence(status.light, pace.take(status.light?.computed, now)));
    showPublishing(status.publish ?? []);
  }
  showStages(stages);
  showCountdown();
}

function showPublishing(targets) {
  const list = $('publish');
  list.hidden = !targets.length;
  while (list.children.length > targets.length) list.lastChild.remove();
  while (list.children.length < targets.length) list.append(document.createElement('li'));
  targets.forEach((target, i) => setTextOf(list.children[i], publishSentence(target)));
}

function showStages(stages) {
  const values = STAGES.map(([key]) => stages[key].median());
  const sum = values.reduce((a, b) => a + (b || 0), 0);
  STAGES.forEach(([key], i) => {
    const share = sum > 0 ? ((values[i] || 0) / sum) * 100 : 0;
    // Set through the object model: the content security policy forbids style attributes.
    $(`bar-${key}`).style.flexGrow = share.toFixed(2);
    setText(`ms-${key}`, milliseconds(values[i]));
  });
}

// ---- user actions

// Panels below the window's edge, as on a phone, are scrolled into view instead of hidden.
function togglePanels() {
  const hidden = document.body.classList.contains('plain');
  const top = $('panels').getBoundingClientRect().top;
  if (!hidden && top > window.innerHeight - 48) {
    $('panels').scrollIntoView({ block: 'start' });
    return;
  }
  document.body.classList.toggle('plain', !hidden);
  $('panels-button').setAttribute('aria-pressed', String(hidden));
}

async function toggleFullscreen() {
  try {
    if (document.fullscreenElement) await document.exitFullscreen();
    else await $('stage').requestFullscreen();
  } catch {
    // not allowed here
  }
}

function pressed(event) {
  if (event.defaultPrevented || ($('help').open && keyOf(event) !== '?')) return;
  keys.press(event);
}

function listen() {
  withKey(app, $('help-button'), '?', 'Help', () => showHelp($('help'), keys, byHls));
  if (!byHls) withKey(app, $('panels-button'), 'i', 'Show or hide the panels', togglePanels);
  withKey(app, $('theme-button'), 'd', 'Dark or light page', () => say(switchTheme() === 'dark' ? 'Dark' : 'Light'));
  if (document.fullscreenEnabled) withKey(app, $('full-button'), 'f', 'Full screen on or off', toggleFullscreen);
  else $('full-button').hidden = true;
  for (const button of document.querySelectorAll('.again'))
    button.onclick = () => send({ op: 'retry', person: true });
  $('access').addEventListener('submit', useToken);
  document.addEventListener('keydown', pressed);
  watchPage((message) => send(message));
}

async function mountAll() {
  const loaded = await Promise.allSettled(MODULES.map((name) => import(name)));
  loaded.forEach(({ value, reason }, i) => {
    try {
      if (reason) throw reason;
      value.mount(app);
    } catch (error) {
      console.error(MODULES[i], error);
    }
  });
  makePanel('figures', 'Statistics');
}

// The published stream has neither controls nor figures.
async function showStream() {
  document.body.classList.add('plain');
  $('panels-button').hidden = true;
  const { watchHls } = await import('./hls.js');
  send = watchHls($('picture'), { relight, show: showStreamState, drawn: drawnStream });
}

function showStreamState(state) {
  if (JSON.stringify(state) !== JSON.stringify(relight.state)) showState(state);
  else showCountdown();
}

function drawnStream({ videoWidth, videoHeight }) {
  document.body.classList.add('seen');
  setText('about', `A scene relit by a live sky; HLS, ${videoWidth}\u00a0×\u00a0${videoHeight}.`);
}

startTheme();
showState(relight.state);
listen();
if (byHls) {
  await showStream();
} else {
  await mountAll();
  setInterval(showFigures, 250);
  setInterval(showWaits, 100);
  send = await startPlayer({ ...wishedRole(location), ...wishedPictures(location) }, take);
}
