// Playing: the gate sweeps through the range, or the page shows one of many gates after the other.

import { byId } from './dom.js';

/** Minimum time per step in ms, and the maximum if the picture of the step does not come. */
const LEAST = { gate: 300, many: 125 };
const MOST = 4000;
/** The gate moves by this fraction of its width per step. */
const PART = 0.5;

/** `advance(direction, part)` makes a step and returns false at the end. */
export function makePlay(link, { model, advance }) {
  const button = byId('gate-play');
  let timer = 0;
  let started = 0;
  let asked = null; // Revision before the present step, and whether the picture of this step has arrived.
  let state = null;
  let rewind = null;

  link.on('state', next => { state = next; });
  link.on('connection', ({ open }) => { if (!open) stop(); });
  link.on('problem', () => stop());

  function step() {
    started = performance.now();
    asked = { after: state.revision, isSeen: false };
    if (!advance(1, PART)) rewind();
    timer = setTimeout(wait, LEAST[model.bins.length > 1 ? 'many' : 'gate']);
  }

  function wait() {
    if (asked.isSeen || performance.now() - started > MOST) step();
    else timer = setTimeout(wait, 30);
  }

  function stop() {
    clearTimeout(timer);
    timer = 0;
    button.textContent = 'Play';
    button.classList.remove('on');
  }

  return {
    stop,
    toggle(toBegin) {
      if (timer) return stop();
      rewind = toBegin;
      button.textContent = 'Stop';
      button.classList.add('on');
      step();
    },
    /** A picture has arrived. A step waits for the whole image, not for a coarse picture. */
    seen(frame) {
      if (!timer || frame.width !== state.resolution[0]) return;
      const isThis = model.bins.length > 1 ? frame.isSum || frame.response === model.bin : frame.revision > asked.after;
      if (isThis) asked.isSeen = true;
    },
  };
}
