// Compares the picture with one that was kept (A): shows the present picture (B), A, or the difference of the two.

import { byId, choose, chosen, onChoice } from './dom.js';
import { HALF, toHalf, valueAt } from './frame.js';

/** The largest value of a difference is scaled to this half float, as in picture.rs. */
const LARGEST_HALF = 32768;

/** `latest` returns the newest picture, and `onChange` is called when another one is to be shown. */
export function makeCompare({ latest, onChange }) {
  let kept = null;
  let count = 0; // Of pictures that were kept.

  function show() {
    byId('compare').hidden = !kept;
    if (!kept) choose('compare', 'b');
  }

  byId('keep').addEventListener('click', () => {
    const frame = latest();
    if (!frame) return;
    kept = frame;
    count += 1;
    show();
    onChange();
  });
  onChoice('compare', onChange);
  show();

  /** Whether A is shown, or takes part in what is shown. */
  const isUsed = frame => kept !== null && kept.layer === frame.layer && chosen('compare') !== 'b';

  /** A is compared with pictures of the same layer only; beside others, the page shows B and offers nothing else. */
  function offer(frame) {
    const fits = kept !== null && kept.layer === frame.layer;
    if (kept && !fits) choose('compare', 'b');
    byId('compare').disabled = !fits;
  }

  return {
    /** The picture to show instead of `frame`, the newest one. */
    apply(frame) {
      offer(frame);
      if (!isUsed(frame)) return frame;
      const number = `${frame.number} ${chosen('compare')} ${count}`;
      return chosen('compare') === 'a' ? { ...kept, number } : { ...difference(frame, kept), number };
    },
    /** A, if it is shown or takes part in what is shown; else null. */
    kept: frame => (frame && isUsed(frame) ? kept : null),
  };
}

/** |b - a| for each channel, in the pixels of b. */
function difference(b, a) {
  const { width, height } = b;
  const values = new Float32Array(3 * width * height);
  let largest = 0;
  for (let y = 0, at = 0; y < height; y++) {
    for (let x = 0; x < width; x++, at += 3) {
      const other = valueAt(a, (x + 0.5) / width, (y + 0.5) / height);
      for (let channel = 0; channel < 3; channel++) {
        const value = Math.abs(HALF[b.half[at + channel]] * b.scale - other[channel]);
        values[at + channel] = value;
        if (value > largest) largest = value;
      }
    }
  }
  const scale = largest > 0 ? largest / LARGEST_HALF : 1;
  return { ...b, isDifference: true, scale, half: Uint16Array.from(values, value => toHalf(value / scale)) };
}
