// Pointer, wheel and keys on the stage: they move the picture or the camera, and hold a pixel.

import { dolly, look, move, orbit, viewHeight } from './camera.js';
import { byId, chosen } from './dom.js';

/** Radians per CSS pixel of dragging. */
const TURN = 0.006;
/** An arrow key turns the camera by this angle in radians, or moves the picture by this many pixels. */
const KEY_TURN = 0.06;
const KEY_MOVE = 32;
const ZOOM_STEP = 1.25;
/** A press that moves less than this (CSS pixels) is a click. */
const CLICK = 4;

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** `onPoint` gets the pixel under the pointer, or null; `onHold` the pixel to hold, or null to release it. */
export function makeTools({ picture, steering, onPoint, onHold, onPause }) {
  const stage = byId('stage');
  const { view } = picture;
  let drag = null;

  const at = event => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  /** What a press does: hand (moves the picture), shift (moves the camera sideways), or the tool. */
  function actionOf(event) {
    if (event.button === 1 || event.shiftKey) return 'hand';
    return event.button === 2 ? 'shift' : chosen('tool');
  }

  function dragBy(action, dx, dy) {
    if (action === 'hand') view.moveBy(dx, dy);
    else if (action === 'shift') steering.change(camera => {
      const metres = viewHeight(camera) / (view.now.image[1] * view.now.zoom);
      return move(camera, -dx * metres, dy * metres, 0);
    });
    else if (action === 'orbit') steering.change(camera => orbit(camera, dx * TURN, -dy * TURN));
    else steering.change(camera => look(camera, -dx * TURN * 0.5, -dy * TURN * 0.5));
  }

  stage.addEventListener('pointerdown', event => {
    // A second finger changes nothing.
    if (event.button > 2 || drag) return;
    stage.focus({ preventScroll: true });
    stage.setPointerCapture(event.pointerId);
    drag = { action: actionOf(event), last: at(event), far: 0, button: event.button, pointer: event.pointerId };
    event.preventDefault();
  });
  // The middle button would scroll the page.
  stage.addEventListener('mousedown', event => { if (event.button === 1) event.preventDefault(); });
  stage.addEventListener('pointermove', event => {
    if (drag && event.pointerId !== drag.pointer) return;
    const here = at(event);
    onPoint(view.pixelAt(...here));
    if (!drag) return;
    const [dx, dy] = [here[0] - drag.last[0], here[1] - drag.last[1]];
    drag.far += Math.abs(dx) + Math.abs(dy);
    drag.last = here;
    if (drag.far >= CLICK) dragBy(drag.action, dx, dy);
  });
  stage.addEventListener('pointerup', event => {
    if (event.pointerId !== drag?.pointer) return;
    if (drag.far < CLICK && drag.button === 0 && !event.shiftKey) onHold(view.pixelAt(...at(event)));
    drag = null;
  });
  for (const kind of ['pointercancel', 'lostpointercapture']) {
    stage.addEventListener(kind, event => { if (event.pointerId === drag?.pointer) drag = null; });
  }
  stage.addEventListener('pointerleave', () => onPoint(null));
  stage.addEventListener('contextmenu', event => event.preventDefault());
  stage.addEventListener('wheel', event => {
    event.preventDefault();
    // Convert lines and pages to pixels. In some browsers, Alt turns the wheel into sideways scrolling.
    const amount = (event.deltaY || event.deltaX) * [1, 16, 400][event.deltaMode];
    const factor = Math.exp(-Math.max(-240, Math.min(240, amount)) * 0.0018);
    if (event.altKey || chosen('tool') === 'fly') steering.change(camera => dolly(camera, factor));
    else view.zoomBy(factor, ...at(event));
  }, { passive: false });

  function arrow(event, [x, y]) {
    if (event.altKey) {
      const held = picture.held() ?? view.now.image.map(size => Math.floor(size / 2));
      onHold(held.map((place, axis) => Math.max(0, Math.min(view.now.image[axis] - 1, place + [x, y][axis]))));
      return;
    }
    const tool = chosen('tool');
    if (tool === 'hand') view.moveBy(-x * KEY_MOVE, -y * KEY_MOVE);
    else if (event.shiftKey) steering.change(camera => {
      const step = 0.05 * viewHeight(camera);
      return move(camera, x * step, -y * step, 0);
    });
    else if (tool === 'orbit') steering.change(camera => orbit(camera, x * KEY_TURN, -y * KEY_TURN));
    else steering.change(camera => look(camera, -x * KEY_TURN, -y * KEY_TURN));
  }

  const keys = {
    '+': () => view.zoomBy(ZOOM_STEP),
    '=': () => view.zoomBy(ZOOM_STEP),
    '-': () => view.zoomBy(1 / ZOOM_STEP),
    0: () => view.fit(),
    1: () => view.oneToOne(),
    r: () => steering.reset(),
    PageUp: () => steering.change(camera => dolly(camera, 1.1)),
    PageDown: () => steering.change(camera => dolly(camera, 1 / 1.1)),
    Enter: () => onHold(view.now.image.map(size => Math.floor(size / 2))),
    Escape: () => onHold(null),
    ' ': () => onPause(),
  };
  stage.addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (ARROWS[key]) arrow(event, ARROWS[key]);
    else if (event.altKey) return;
    else if (Object.hasOwn(keys, key)) keys[key]();
    else if (!steering.press(key, event.shiftKey)) return;
    event.preventDefault();
  });
  stage.addEventListener('keyup', event => steering.release(event.key.toLowerCase()));
  stage.addEventListener('blur', () => steering.releaseAll());

  byId('zoom-in').addEventListener('click', () => view.zoomBy(ZOOM_STEP));
  byId('zoom-out').addEventListener('click', () => view.zoomBy(1 / ZOOM_STEP));
  byId('zoom-fit').addEventListener('click', () => view.fit());
  byId('zoom-one').addEventListener('click', () => view.oneToOne());
}
