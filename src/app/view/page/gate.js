// The gate: its controls, and what the time line does with it.

import { byId, choose, fill, onChoice, onEdit, setOptions } from './dom.js';
import { makePlay } from './play.js';
import { makeTimeline } from './timeline.js';
import { UNITS, describeGate, gateChange, gatesChange, inUnit, niceStep, parseTravelTime } from './units.js';

/** After this time (ms) without a change on this page, and without a change that waits for its answer, the page follows the gate of
 * the program again. */
const SETTLE = 500;

/** `onBin` is called with the number of the response that this page wants to see. */
export function makeGate(link, { onBin, onProblem }) {
  const model = { mode: 'steady', lo: 0, hi: Infinity, bins: [], bin: 0, unit: 'm' };
  let touched = -Infinity;
  let isSum = false;
  let offered = []; // Gates that the program offers.
  let suggested = null; // The offered gate around the median travel time, as [lo, hi].
  let latest = null;
  let about = null; // Middle of the gate that the user saw or picked last, in metres.

  const timeline = makeTimeline(model, { move, pick });
  const play = makePlay(link, { model, advance });

  /** Sets the gate, or the range of many gates, to [lo, hi) in metres. */
  function move(lo, hi) {
    if (!(hi > lo)) return onProblem('The gate is empty: it must end after it begins.');
    [model.lo, model.hi] = [Math.max(0, lo), hi];
    touched = performance.now();
    if (model.mode === 'many') {
      const count = model.bins.length > 1 ? model.bins.length : Number(byId('gate-count').value);
      link.set(gatesChange(model.lo, model.hi, count, model.unit));
    } else {
      model.mode = 'gate';
      link.set(gateChange(model.lo, model.hi, model.unit));
    }
    show();
  }

  function pick(bin) {
    if (bin === model.bin) return;
    model.bin = bin;
    about = middle(model.bins[bin].lo, model.bins[bin].hi ?? Infinity);
    onBin(bin);
    show();
  }

  /** One step of playing or of the buttons. Returns false at the end of the range. */
  function advance(direction, part = 1) {
    if (model.bins.length > 1) {
      const next = model.bin + direction;
      if (next < 0 || next >= model.bins.length) return false;
      pick(next);
      return true;
    }
    if (model.mode !== 'gate' || model.hi === Infinity) return false;
    const size = model.hi - model.lo;
    const lo = Math.max(0, model.lo + direction * size * part);
    // Not the whole range, which contains every gate and so would grow with each step.
    const [from, to] = timeline.light();
    if (part < 1 && (lo + size > to || lo < from)) return false;
    move(lo, lo + size);
    return true;
  }

  /** Goes to the first gate of the range, to play from there. */
  function rewind() {
    if (model.bins.length > 1) return pick(0);
    const [from] = timeline.light();
    move(from, from + model.hi - model.lo);
  }

  function show() {
    const { mode, lo, hi, unit } = model;
    choose('gate-mode', mode);
    byId('gate-numbers').hidden = mode === 'steady' || mode === 'other';
    byId('gate-count-group').hidden = mode !== 'many';
    byId('gate-steps').hidden = mode === 'steady';
    showPresets();
    fill(byId('gate-from'), inUnit(lo, unit));
    fill(byId('gate-to'), hi === Infinity ? 'inf' : inUnit(hi, unit));
    const count = model.bins.length > 1 ? model.bins.length : 1;
    fill(byId('gate-width'), hi === Infinity ? 'inf' : inUnit((hi - lo) / count, unit, 6));
    const bin = model.bins[model.bin];
    const many = model.bins.length > 1 && bin;
    byId('gate-text').textContent = many && isSum ? `The picture shows the sum of all ${count} gates.`
      : many ? `${bin.name} of ${model.bins[0].name} to ${model.bins[count - 1].name}: ${describeGate(bin.lo, bin.hi ?? Infinity)}`
      : mode === 'steady' ? 'All travel times (steady state). Drag on the time line to set a gate.' : describeGate(lo, hi);
    if (mode === 'gate') about = middle(lo, hi);
    timeline.draw();
  }

  /** The gates of the user's named responses; without named responses, the gates that the program offers. */
  function presets() {
    if (model.mode === 'other') return model.bins.map((gate, bin) => ({ ...gate, bin }));
    return model.mode === 'many' ? [] : offered;
  }

  function showPresets() {
    const all = presets();
    const select = byId('gate-preset');
    const near = (a, b) => Math.abs(a - b) < 1e-6 * (model.hi - model.lo);
    const present = all.find(({ bin, lo, hi }) => (bin === undefined ? near(lo, model.lo) && near(hi, model.hi) : bin === model.bin));
    const names = [...(present ? [] : ['']), ...all.map(({ name }) => name)];
    if (names.join('\n') !== [...select.options].map(({ value }) => value).join('\n')) {
      setOptions(select, names.map(name => [name, name || '–']));
    }
    select.value = present?.name ?? '';
    byId('gate-presets').hidden = all.length === 0;
  }

  function pickPreset(name) {
    const preset = presets().find(preset => preset.name === name);
    if (!preset) return show();
    if (preset.bin !== undefined) return pick(preset.bin);
    touched = -Infinity;
    link.set(gateChange(preset.lo, preset.hi, model.unit));
  }

  function followState(state) {
    latest = state;
    const { settings, responses } = state;
    const isOther = responses.length !== model.bins.length;
    model.bins = responses;
    if (responses.length > 1) fill(byId('gate-count'), responses.length);
    const isBusy = timeline.isDragging() || link.isChanging() || performance.now() - touched < SETTLE;
    if (!isBusy) {
      const first = responses[0];
      const whole = [first.lo, Math.max(...responses.map(({ hi }) => hi ?? Infinity))];
      if (settings.gates) model.mode = 'many';
      else if (responses.length > 1) model.mode = 'other';
      else model.mode = first.hi === null && first.lo === 0 ? 'steady' : 'gate';
      if (model.mode !== 'steady') [model.lo, model.hi] = whole;
    }
    if (isOther) chooseBin();
    show();
  }

  /** In a new set of gates, chooses the one that contains the middle of the gate shown before. */
  function chooseBin() {
    const bin = model.bins.length > 1 ? timeline.binAt(about ?? suggested?.[0] ?? 0) : 0;
    if (bin !== model.bin) onBin(model.bin = bin);
  }

  // Follows the newest state once the user has stopped.
  function settle() {
    if (latest && !timeline.isDragging()) followState(latest);
  }

  onChoice('gate-mode', mode => {
    touched = -Infinity;
    play.stop();
    if (mode === 'steady') return link.set({ gate: false, depth: false, gates: false });
    // Use the gate that was shown before; else the suggested gate, or the middle third of the range.
    const [a, b] = timeline.range();
    const hasGate = model.lo > 0 && model.hi < Infinity;
    if (mode === 'gate') {
      const bin = model.bins.length > 1 ? model.bins[model.bin] : null;
      const ends = bin ? [bin.lo, bin.hi ?? Infinity] : hasGate ? [model.lo, model.hi] : suggested ?? [a + (b - a) / 3, b - (b - a) / 3];
      link.set(gateChange(...ends, model.unit));
    } else {
      // The range begins and ends at round numbers.
      const unit = UNITS[model.unit].metres;
      const step = niceStep((b - a) / unit, 20) * unit;
      const ends = [Math.floor(a / step) * step, Math.ceil(b / step) * step];
      link.set(gatesChange(...ends, Number(byId('gate-count').value) || 30, model.unit));
    }
  });
  onEdit(byId('gate-unit'), unit => { model.unit = unit; show(); });
  const typed = (id, change) => onEdit(byId(id), text => {
    const metres = /^(inf|∞)$/.test(text) ? Infinity : parseTravelTime(text, model.unit);
    if (metres === null || Number.isNaN(metres)) {
      onProblem(`'${text}' is not a travel time: write it like 6.2, 6.2m or 20.7ns.`);
      return show();
    }
    change(metres);
    show();
  }, show);
  typed('gate-from', metres => move(metres, model.hi > metres ? model.hi : metres + (model.hi - model.lo)));
  typed('gate-to', metres => move(model.lo, metres));
  typed('gate-width', metres => move(model.lo, model.lo + metres * Math.max(1, model.bins.length)));
  onEdit(byId('gate-count'), text => {
    touched = -Infinity;
    link.set(gatesChange(model.lo, model.hi, Math.round(Number(text)), model.unit));
  }, show);
  byId('gate-back').addEventListener('click', () => advance(-1));
  byId('gate-next').addEventListener('click', () => advance(1));
  byId('gate-play').addEventListener('click', () => play.toggle(rewind));
  byId('gate-preset').addEventListener('change', event => pickPreset(event.target.value));

  link.on('state', followState);
  link.on('problem', () => { touched = -Infinity; settle(); });
  link.on('answered', settle);
  link.on('progress', () => { if (performance.now() - touched > SETTLE && performance.now() - touched < 4 * SETTLE) settle(); });
  link.on('arrivals', message => {
    offered = message.presets;
    const median = offered.find(({ name }) => name === 'Median');
    suggested = median ? [median.lo, median.hi] : null;
    timeline.take(message);
    if (about === null) chooseBin();
    show();
  });
  link.on('picture', frame => {
    play.seen(frame);
    if (isSum === frame.isSum) return;
    isSum = frame.isSum;
    show();
  });

  return { model, showPixel: timeline.showPixel };
}

const middle = (lo, hi) => (hi === Infinity ? lo : (lo + hi) / 2);
