// Moving the camera, also by keys (controls.js): Alt-drag, or two fingers, turns it around the point it looks at; Alt and wheel, or pinching, changes its
// distance. The view is text, "@x,y,z;x,y,z;degrees" (PROTOCOL.md 4.13.15); the server shows each as soon as it can.

const TURN = Math.PI; // per image width
const STEEP = 1.5; // radians: almost straight up or down
const NEAREST = 1e-3; // m
const PAUSE_MS = 60; // between two views

export const isFreeView = (camera) => typeof camera === 'string' && camera.startsWith('@');

// {position, target: [x, y, z], fov}, or null.
export function parseView(text) {
  const parts = isFreeView(text) ? text.slice(1).split(';') : [];
  const [position, target, [fov] = []] = parts.map((part) => part.split(',').map(Number));
  const good = parts.length === 3 && [position, target].every((p) => p.length === 3 && p.every(Number.isFinite)) && fov > 0;
  return good ? { position, target, fov } : null;
}

const number = (x) => String(Number((Math.round(x * 1e4) / 1e4).toPrecision(6)));
export const formatView = ({ position, target, fov }) => `@${position.map(number).join(',')};${target.map(number).join(',')};${number(fov)}`;

// The view turned about its target: dx, dy in image widths to the right and down; distance times `zoom`.
export function orbited({ position, target, fov }, dx, dy, zoom = 1) {
  const [x, y, z] = position.map((p, i) => p - target[i]);
  const distance = Math.max(NEAREST, Math.hypot(x, y, z));
  const around = Math.atan2(x, z) - dx * TURN;
  const up = Math.max(-STEEP, Math.min(STEEP, Math.asin(Math.max(-1, Math.min(1, y / distance))) + dy * TURN));
  const far = Math.max(NEAREST, distance * zoom);
  const ahead = [Math.sin(around) * Math.cos(up), Math.sin(up), Math.cos(around) * Math.cos(up)];
  return { position: target.map((t, i) => t + far * ahead[i]), target, fov };
}

export function orbitByDragging(canvas, controls) {
  let from = null; // {view, x, y, id, spread}
  let wanted = null;
  let timer;

  // The last view asked for, while its answer is on the way, else the shown one.
  const current = () => parseView(wanted) ?? parseView(controls.now.camera) ?? parseView(controls.app.status?.view);
  const ask = (view) => {
    const text = formatView(view);
    if (text === formatView(from.view)) return; // not moved yet
    wanted = text;
    timer ??= setTimeout(() => {
      timer = undefined;
      controls.ask({ camera: wanted });
    }, PAUSE_MS);
  };
  const move = (x, y, spread) => {
    const zoom = spread && from.spread ? from.spread / spread : 1;
    ask(orbited(from.view, (x - from.x) / canvas.clientWidth, (y - from.y) / canvas.clientWidth, zoom));
  };
  const begin = (x, y, more) => {
    const view = controls.may ? current() : null;
    if (view) from = { view, x, y, ...more };
    return Boolean(view);
  };
  controls.app.on('control', ({ camera }) => { if (!timer && camera !== wanted) wanted = null; });

  canvas.addEventListener('pointerdown', (event) => {
    if (event.pointerType === 'touch' || !event.altKey || event.button !== 0) return;
    if (begin(event.clientX, event.clientY, { id: event.pointerId })) canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointermove', (event) => {
    if (from && event.pointerId === from.id) move(event.clientX, event.clientY);
  });
  canvas.addEventListener('pointerup', (event) => {
    if (from?.id !== event.pointerId) return;
    from = null;
    window.addEventListener('click', (click) => click.stopPropagation(), { capture: true, once: true });
  });
  canvas.addEventListener('pointercancel', () => { from = null; });
  canvas.addEventListener('wheel', (event) => {
    if (!event.altKey || !begin(0, 0)) return;
    event.preventDefault();
    ask(orbited(from.view, 0, 0, Math.exp(event.deltaY * 0.001)));
    from = null;
  }, { passive: false });

  const middle = ([a, b]) => [(a.clientX + b.clientX) / 2, (a.clientY + b.clientY) / 2,
    Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY)];
  canvas.addEventListener('touchstart', (event) => {
    if (event.touches.length !== 2) return;
    const [x, y, spread] = middle(event.touches);
    if (begin(x, y, { spread })) event.preventDefault();
  }, { passive: false });
  canvas.addEventListener('touchmove', (event) => {
    if (event.touches.length !== 2 || !from) return;
    event.preventDefault();
    move(...middle(event.touches));
  }, { passive: false });
  canvas.addEventListener('touchend', (event) => { if (event.touches.length < 2) from = null; });

  // One step, as if by dragging; false: there is no view to start from, or no right to.
  return (dx, dy, zoom = 1) => {
    if (!begin(0, 0)) return false;
    ask(orbited(from.view, dx, dy, zoom));
    from = null;
    return true;
  };
}
