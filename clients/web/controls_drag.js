// Dragging across the image rotates the sky; a click stays a click.

import { wrapDegrees } from './controls_model.js';

const SLACK = 6; // CSS pixels before a press becomes a drag
const TURN = 120; // degrees per image width

// Positive angles rotate the sky right-handed about +Y, which moves the view ahead to the left.
export const turned = (start, dx, width) => wrapDegrees(start - (dx * TURN) / Math.max(1, width));

export function turnByDragging(canvas, controls) {
  let from = null; // {x, degrees, id, dragging}

  canvas.addEventListener('pointerdown', (event) => {
    if (!event.isPrimary) from = null; // a second finger: they move the camera (controls_orbit.js)
    if (!controls.may || event.button !== 0 || !event.isPrimary || event.altKey) return;
    from = { x: event.clientX, degrees: controls.now.rotate_degrees ?? 0, id: event.pointerId, dragging: false };
  });
  canvas.addEventListener('pointermove', (event) => {
    if (!from || event.pointerId !== from.id) return;
    const dx = event.clientX - from.x;
    if (!from.dragging && Math.abs(dx) < SLACK) return;
    if (!from.dragging) canvas.setPointerCapture(from.id);
    from.dragging = true;
    controls.ask({ rotate_degrees: Math.round(turned(from.degrees, dx, canvas.clientWidth)) });
  });
  const end = () => {
    if (from?.dragging) // suppress the click that follows a drag
      window.addEventListener('click', (event) => event.stopPropagation(), { capture: true, once: true });
    from = null;
  };
  canvas.addEventListener('pointerup', end);
  canvas.addEventListener('pointercancel', () => { from = null; });
}
