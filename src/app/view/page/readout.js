// The values of a pixel: the one under the pointer, or the one that is held.

import { byId } from './dom.js';
import { valueAt } from './frame.js';
import { quantity, short, withError } from './units.js';

/** The values are asked for again this often (ms) while pictures and progress arrive, and once after the last of them. */
const AGAIN = 500;

/** `onHistogram` gets the light of the pixel in each gate, or null. */
export function makeReadout(link, picture, { onHistogram }) {
  let pointed = null;
  let answer = null;
  let asked = -Infinity;
  let timer = 0;

  const pixel = () => picture.held() ?? pointed;

  function ask() {
    const at = pixel();
    clearTimeout(timer);
    timer = 0;
    if (!at) return;
    asked = performance.now();
    link.pixel(...at);
  }

  function show() {
    const at = pixel();
    const frame = picture.frame();
    byId('unpin').hidden = !picture.held();
    byId('readout-place').textContent = at ? `${picture.held() ? 'Held ' : ''}x ${at[0]}, y ${at[1]}` : 'No pixel';
    // An answer may belong to an earlier picture, or to another gate.
    const isThis = at && answer && answer.x === at[0] && answer.y === at[1] && answer.revision >= (frame?.revision ?? 0)
      && (frame?.layer !== 'mean' || answer.response === frame.response);
    const [radiance, more] = [byId('readout-radiance'), byId('readout-more')];
    radiance.textContent = more.textContent = '';
    onHistogram(isThis ? answer.histogram : null);
    if (!at) return;
    const { image } = picture.view.now;
    const place = [0, 1].map(axis => (at[axis] + 0.5) / image[axis]);
    const kept = picture.kept();
    const of = kept ? 'B: ' : '';
    if (isThis) {
      radiance.textContent = `${of}${values(answer.radiance, answer.error)} W/(m² sr)`;
      more.textContent = [
        `${short(answer.samples, 6)} samples`,
        answer.depth === null ? '' : `depth ${quantity(answer.depth)} m`,
        answer.object ?? '',
      ].filter(Boolean).join(' · ');
    } else if (frame?.layer === 'mean') {
      // The picture already gives the radiance; the answer of the program will give the rest.
      radiance.textContent = `${of}${values(valueAt(frame, ...place), null)} W/(m² sr)`;
    }
    if (kept?.layer === 'mean') more.textContent = [`A: ${values(valueAt(kept, ...place), null)}`, more.textContent].filter(Boolean).join(' · ');
  }

  function askAgain() {
    timer ||= setTimeout(ask, Math.max(0, asked + AGAIN - performance.now()));
  }

  link.on('pixel', message => { answer = message; show(); });
  link.on('picture', () => { askAgain(); show(); });
  // The depths and objects arrive later than the first picture.
  link.on('progress', askAgain);
  byId('unpin').addEventListener('click', () => hold(null));

  function hold(at) {
    picture.hold(at);
    ask();
    show();
  }

  return {
    hold,
    point(at) {
      const isNew = at?.[0] !== pointed?.[0] || at?.[1] !== pointed?.[1];
      pointed = at;
      if (picture.held() || !isNew) return;
      ask();
      show();
    },
    ask,
  };
}

function values(radiance, error) {
  return ['R', 'G', 'B'].map((name, k) => `${name} ${withError(radiance[k], error?.[k])}`).join('  ');
}
