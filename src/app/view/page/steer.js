// The camera that the user steers: it runs ahead of the program while the user moves it, and follows the program otherwise.

import { cameraChange, cameraOf, move, viewHeight } from './camera.js';

/** After this time (ms) without a movement, and without a change that waits for its answer, the page follows the camera of the program
 * again. */
const SETTLE = 500;
/** Flying speed in heights of the view per second, and the factor by which Shift multiplies it. */
const SPEED = 0.7;
const FAST = 4;
/** A short press of a key flies for this time, in seconds. */
const TAP = 0.05;

const FLY_KEYS = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], e: [0, 1, 0], q: [0, -1, 0] };

export function makeSteering(link) {
  let camera = null;
  let moved = -Infinity;
  const pressed = new Set();
  let fast = false;
  let last = 0;

  function change(by) {
    if (!camera) return;
    camera = by(camera);
    moved = performance.now();
    link.set(cameraChange(camera));
  }

  function fly(now) {
    if (pressed.size === 0) return;
    const seconds = Math.min(0.1, (now - last) / 1000);
    last = now;
    step(pressed, seconds);
    requestAnimationFrame(fly);
  }

  function step(keys, seconds) {
    const way = [0, 0, 0];
    for (const key of keys) FLY_KEYS[key].forEach((part, axis) => { way[axis] += part; });
    change(from => {
      const size = SPEED * viewHeight(from) * seconds * (fast ? FAST : 1);
      return move(from, ...way.map(part => part * size));
    });
  }

  let latest = null;
  const follow = () => {
    if (!link.isChanging() && performance.now() - moved > SETTLE) camera = latest;
  };
  link.on('state', state => {
    latest = cameraOf(state);
    follow();
  });
  link.on('answered', follow);
  // The program may have refused the camera, so go back to its newest camera.
  link.on('problem', () => { camera = latest; });

  return {
    change,
    camera: () => camera,
    reset() {
      moved = -Infinity;
      // The program also resets the place and the view.
      link.set({ camera: null });
    },
    /** Returns whether the key is one of those that fly. */
    press(key, isFast) {
      if (!Object.hasOwn(FLY_KEYS, key)) return false;
      fast = isFast;
      if (!pressed.has(key)) step([key], TAP);
      if (pressed.size === 0) {
        last = performance.now();
        requestAnimationFrame(fly);
      }
      pressed.add(key);
      return true;
    },
    release: key => pressed.delete(key),
    releaseAll: () => pressed.clear(),
  };
}
