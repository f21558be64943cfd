// The time line: histogram of arriving light, axis, and the handles of the gate, which are sliders for pointer and keyboard.

import { byId, fitCanvas, onceAFrame } from './dom.js';
import { UNITS, inUnit, niceStep, short } from './units.js';

const AXIS_HEIGHT = 18;
/** Width of the handles in CSS pixels; they lie outside of the gate. */
const GRIP = 24;
/** Room at each side of the time line in CSS pixels, so that the visible part of a handle at its end lies inside. */
const PAD = 12;
/** Decades of the logarithmic scale. */
const DECADES = 4;
/** Empty margin at each side, as a fraction of the range. */
const MARGIN = 0.02;
/** An arrow key moves a handle by this fraction of the visible range; with Shift ten times as far. */
const KEY_STEP = 1 / 500;
/** Minimum visible range, relative to its end. A smaller one would be finer than the numbers. */
const LEAST_SPAN = 1e-9;

const COLOURS = { axis: '#a6a6a6', line: '#3a3a3a', bars: '#7d8a96', within: '#e0a33c', window: 'rgb(224 163 60 / 0.12)', pixel: '#6fb3f2' };

/**
 * `model` is { mode, lo, hi, bins, bin, unit } with travel times in metres. `actions` are move(lo, hi), which sets the gate, and
 * pick(bin), which chooses the gate that is shown.
 */
export function makeTimeline(model, actions) {
  const track = byId('track');
  const range = { whole: [0, 1], shown: null };
  let arrivals = null;
  let pixel = null;
  let drag = null;

  const shown = () => range.shown ?? range.whole;
  const width = () => Math.max(1, track.clientWidth - 2 * PAD);
  const toX = metres => PAD + ((metres - shown()[0]) / (shown()[1] - shown()[0])) * width();
  const toMetres = x => shown()[0] + ((x - PAD) / width()) * (shown()[1] - shown()[0]);
  const hasGate = () => model.mode !== 'steady';
  /** Where the handle of the gate's end is: a gate without end ends with the visible range. */
  const end = () => (model.hi === Infinity ? Math.max(shown()[1], model.lo) : model.hi);

  /** Sets the whole range, so that it contains the histogram and the gate. */
  function measure() {
    let ends = arrivals?.light.length ? [arrivals.begin, arrivals.end] : null;
    if (hasGate() && model.hi < Infinity) {
      ends = ends ? [Math.min(ends[0], model.lo), Math.max(ends[1], model.hi)] : [model.lo, model.hi];
    }
    if (!ends || drag) return;
    const margin = MARGIN * (ends[1] - ends[0] || 1);
    range.whole = [Math.max(0, ends[0] - margin), ends[1] + margin];
  }

  /** Rounds a travel time to a step of the user's unit that is smaller than a pixel. */
  function rounded(metres) {
    const unit = UNITS[model.unit].metres;
    const step = niceStep((shown()[1] - shown()[0]) / unit, 2 * width());
    return Math.max(0, Math.round(metres / unit / step) * step * unit);
  }

  /** The range follows the gate and the light at once: a key may come before the next frame. */
  function draw() {
    measure();
    paint();
  }

  const paint = onceAFrame(() => {
    const { context, width: w, height } = fitCanvas(byId('track-plot'));
    const base = height - AXIS_HEIGHT;
    if (hasGate()) {
      const [x0, x1] = [toX(model.lo), Math.min(w, toX(model.hi))];
      context.fillStyle = COLOURS.window;
      context.fillRect(x0, 0, Math.max(1, x1 - x0), base);
    }
    drawBars(context, base);
    if (model.bins.length > 1) drawBins(context, base);
    // The values may belong to other gates than these.
    if (model.bins.length > 1 && pixel?.length === model.bins.length) drawPixel(context, base, w);
    drawAxis(context, w, base);
    placeHandles(base);
  });

  /** Height of a bar, as a fraction of the height of the plot. */
  function tall(value, most) {
    if (!(value > 0)) return 0;
    return byId('track-log').checked ? Math.max(0, 1 + Math.log10(value / most) / DECADES) : value / most;
  }

  function drawBars(context, base) {
    if (!arrivals) return;
    const { begin, end, light } = arrivals;
    const most = Math.max(...light);
    const step = (end - begin) / light.length;
    const lit = model.bins.length > 1 ? model.bins[model.bin] : model;
    light.forEach((value, k) => {
      const [x0, x1] = [toX(begin + k * step), toX(begin + (k + 1) * step)];
      const middle = begin + (k + 0.5) * step;
      context.fillStyle = hasGate() && middle >= lit.lo && middle < (lit.hi ?? Infinity) ? COLOURS.within : COLOURS.bars;
      const size = tall(value, most) * (base - 8);
      context.fillRect(x0, base - size, Math.max(1, x1 - x0 - (x1 - x0 > 3 ? 1 : 0)), size);
    });
  }

  function drawBins(context, base) {
    context.strokeStyle = COLOURS.axis;
    context.globalAlpha = 0.35;
    context.beginPath();
    for (const { lo } of model.bins) {
      const x = Math.round(toX(lo)) + 0.5;
      context.moveTo(x, base - 6);
      context.lineTo(x, base);
    }
    context.stroke();
    context.globalAlpha = 1;
  }

  /** Draws the light of the held pixel in each gate. */
  function drawPixel(context, base, w) {
    const most = Math.max(...pixel);
    context.strokeStyle = COLOURS.pixel;
    context.lineWidth = 1.5;
    context.beginPath();
    model.bins.forEach(({ lo, hi }, k) => {
      const y = base - tall(pixel[k] ?? 0, most) * (base - 8);
      context.lineTo(toX(lo), y);
      context.lineTo(Math.min(w, toX(hi ?? Infinity)), y);
    });
    context.stroke();
    context.lineWidth = 1;
  }

  function drawAxis(context, w, base) {
    const unit = UNITS[model.unit].metres;
    const [from, to] = shown().map(metres => metres / unit);
    const step = niceStep(to - from, w / 90);
    context.fillStyle = COLOURS.line;
    context.fillRect(0, base, w, 1);
    context.fillStyle = COLOURS.axis;
    context.textAlign = 'center';
    const first = Math.ceil(from / step);
    for (let k = first; k * step <= to && k < first + w; k++) {
      const x = toX(k * step * unit);
      context.fillRect(Math.round(x), base, 1, 4);
      const label = short(k * step, 7);
      const half = context.measureText(label).width / 2;
      if (x > half + 2 && x < w - half - 24) context.fillText(label, x, base + 15);
    }
    context.textAlign = 'right';
    context.fillText(UNITS[model.unit].suffix, w - 4, base + 15);
  }

  function placeHandles(base) {
    const visible = hasGate() && model.mode !== 'other';
    const [x0, x1] = [toX(model.lo), toX(end())];
    const place = (id, left, size, label, value, shownAt = visible) => {
      const handle = byId(id);
      handle.hidden = !shownAt;
      handle.style.left = `${left}px`;
      if (size !== null) handle.style.width = `${size}px`;
      handle.style.height = `${base}px`;
      handle.setAttribute('aria-valuemin', short(shown()[0]));
      handle.setAttribute('aria-valuemax', short(shown()[1]));
      handle.setAttribute('aria-valuenow', short(value));
      handle.setAttribute('aria-valuetext', label);
    };
    const say = metres => (metres === Infinity ? 'no end' : `${inUnit(metres, model.unit)} ${UNITS[model.unit].suffix}`);
    place('gate-begin', x0 - GRIP, null, say(model.lo), model.lo);
    place('gate-end', x1, null, say(model.hi), Math.min(model.hi, 1e30));
    place('gate-window', x0, Math.max(1, x1 - x0), `${say(model.lo)} to ${say(model.hi)}`, model.lo);
    const bin = model.bins[model.bin];
    const many = model.bins.length > 1 && bin !== undefined;
    if (many) {
      const left = toX(bin.lo);
      place('gate-bin', left, Math.max(3, toX(bin.hi ?? shown()[1]) - left), `${bin.name}, ${say(bin.lo)} to ${say(bin.hi ?? Infinity)}`, model.bin, true);
      const handle = byId('gate-bin');
      handle.setAttribute('aria-valuemin', 0);
      handle.setAttribute('aria-valuemax', model.bins.length - 1);
    } else {
      byId('gate-bin').hidden = true;
    }
  }

  /** Index of the gate that contains a travel time, or of the nearest gate. */
  function binAt(metres) {
    const inside = model.bins.findIndex(({ lo, hi }) => lo <= metres && metres < (hi ?? Infinity));
    if (inside >= 0) return inside;
    return metres < model.bins[0].lo ? 0 : model.bins.length - 1;
  }

  /** Moves one end of the gate or the whole gate to `lo` or `hi`. The ends do not pass each other. */
  function moveTo(part, lo, hi) {
    const least = niceStep(shown()[1] - shown()[0], 2000);
    // The whole gate keeps its width, which may be infinite.
    if (part === 'begin') actions.move(Math.min(rounded(lo), model.hi - least), model.hi);
    else if (part === 'end') actions.move(model.lo, Math.max(rounded(hi), model.lo + least));
    else {
      const size = model.hi - model.lo;
      const begin = rounded(lo);
      actions.move(begin, begin + size);
    }
  }

  track.addEventListener('pointerdown', event => {
    // A second finger changes nothing.
    if (event.button !== 0 || drag) return;
    const x = event.clientX - track.getBoundingClientRect().left;
    const metres = toMetres(x);
    const part = { 'gate-begin': 'begin', 'gate-end': 'end', 'gate-window': 'window' }[event.target.id];
    if (model.bins.length > 1 && !['begin', 'end'].includes(part)) {
      drag = { part: 'bin', pointer: event.pointerId };
      byId('gate-bin').focus({ preventScroll: true });
      actions.pick(binAt(metres));
    } else if (part) {
      drag = { part, offset: metres - (part === 'end' ? end() : model.lo), pointer: event.pointerId };
      event.target.focus({ preventScroll: true });
    } else {
      // A press beside the gate draws a new one from there; a mere click moves the gate there.
      drag = { part: 'new', from: metres, x, pointer: event.pointerId };
    }
    track.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  track.addEventListener('pointermove', event => {
    if (event.pointerId !== drag?.pointer) return;
    const x = event.clientX - track.getBoundingClientRect().left;
    const metres = toMetres(x);
    if (drag.part === 'bin') actions.pick(binAt(metres));
    else if (drag.part !== 'new') moveTo(drag.part, metres - drag.offset, metres - drag.offset);
    else if (Math.abs(x - drag.x) > 4) {
      drag.isDrawn = true;
      const ends = [rounded(drag.from), rounded(metres)].sort((a, b) => a - b);
      if (ends[1] > ends[0]) actions.move(...ends);
    }
  });
  track.addEventListener('pointerup', event => {
    if (event.pointerId !== drag?.pointer) return;
    if (drag.part === 'new' && !drag.isDrawn && hasGate() && model.hi < Infinity) {
      moveTo('window', drag.from - (model.hi - model.lo) / 2);
    }
    drag = null;
    draw();
  });
  for (const kind of ['pointercancel', 'lostpointercapture']) {
    track.addEventListener(kind, event => { if (event.pointerId === drag?.pointer) drag = null; });
  }
  track.addEventListener('wheel', event => {
    event.preventDefault();
    zoom(Math.exp(Math.max(-240, Math.min(240, event.deltaY)) * 0.002), toMetres(event.clientX - track.getBoundingClientRect().left));
  }, { passive: false });

  /** Zooms about a travel time, out to the whole range at most. */
  function zoom(factor, about) {
    const [a, b] = shown();
    const [from, to] = range.whole;
    const next = [Math.max(from, about - (about - a) * factor), Math.min(to, about + (b - about) * factor)];
    if (!(next[1] - next[0] >= LEAST_SPAN * to)) return;
    range.shown = next[0] <= from && next[1] >= to ? null : next;
    draw();
  }

  track.addEventListener('keydown', event => {
    const part = { 'gate-begin': 'begin', 'gate-end': 'end', 'gate-window': 'window', 'gate-bin': 'bin' }[event.target.id];
    if (!part || event.ctrlKey || event.metaKey || event.altKey) return;
    const direction = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -1, PageUp: 1 }[event.key];
    const page = event.key.startsWith('Page');
    if (event.key === '+' || event.key === '-') zoom(event.key === '+' ? 0.8 : 1.25, part === 'end' ? end() : model.lo);
    else if (part === 'bin') {
      const last = model.bins.length - 1;
      const next = { Home: 0, End: last }[event.key] ?? (direction && model.bin + direction * (page || event.shiftKey ? 10 : 1));
      if (next === undefined) return;
      actions.pick(Math.max(0, Math.min(last, next)));
    } else {
      const [a, b] = shown();
      const size = end() - model.lo;
      const step = page ? size : (b - a) * KEY_STEP * (event.shiftKey ? 10 : 1);
      const from = part === 'end' ? end() : model.lo;
      const ends = { Home: a, End: part === 'window' ? b - size : b };
      const target = ends[event.key] ?? (direction && from + direction * step);
      if (target === undefined) return;
      moveTo(part, target, target);
    }
    event.preventDefault();
  });

  byId('track-all').addEventListener('click', () => { range.shown = null; draw(); });
  byId('track-log').addEventListener('change', draw);
  new ResizeObserver(draw).observe(track);

  return {
    draw,
    take(message) { arrivals = message; draw(); },
    showPixel(histogram) { pixel = histogram; draw(); },
    isDragging: () => drag !== null,
    range: () => range.whole,
    /** Range of the histogram, whatever the gate is; without a histogram, the whole range. */
    light: () => (arrivals?.light.length ? [arrivals.begin, arrivals.end] : range.whole),
    binAt,
  };
}
