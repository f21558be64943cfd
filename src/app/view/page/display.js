// How values become colours: layer, tone, exposure and the scale of false colours, with their controls and the legend.

import { ERROR_RANGE, MAPS, automatic } from './colours.js';
import { byId, choose, chosen, fill, fitCanvas, make, onChoice, onEdit } from './dom.js';
import { quantity } from './units.js';

/** Automatic ranges change only by more than this, so that noise does not make the picture flicker. */
const STILL_STOPS = 0.08;
/** The slider reaches this many EV to both sides of its middle; the automatic exposure moves the middle if it comes near to an end. */
const REACH = 16;
const NEAR = 12;

/** `onChange` is called when the picture must be drawn again, `onLayer` when another layer is wanted. */
export function makeDisplay({ onChange, onLayer }) {
  const settings = { stops: 0, range: [1e-3, 1], auto: true };
  let latest = null; // The picture that is shown.
  let layer = 'mean'; // The layer of the picture that is shown. The layer that the user chose may not have arrived yet.
  let revision = -1;
  let middle = 0; // Of the slider.

  let depths = [1, 10]; // Scale of the depths, which is always automatic.

  const isFalse = (of = layer) => of === 'error' || of === 'depth' || (of === 'mean' && chosen('tone') === 'false');
  const range = () => ({ error: ERROR_RANGE, depth: depths }[layer] ?? settings.range);

  function follow(frame) {
    if (frame.layer === 'depth') depths = automatic(frame)?.range ?? depths;
    const found = frame.layer === 'mean' && settings.auto ? automatic(frame) : null;
    if (!found) return;
    const far = Math.abs(found.stops - settings.stops) > STILL_STOPS
      || Math.abs(Math.log2(found.range[1] / settings.range[1])) > 4 * STILL_STOPS;
    if (!far && frame.revision === revision) return;
    revision = frame.revision;
    [settings.stops, settings.range] = [found.stops, found.range];
  }

  function show() {
    const wanted = chosen('layer');
    const hasTone = wanted === 'mean';
    byId('tones').hidden = !hasTone;
    byId('exposure').hidden = !hasTone || isFalse(wanted);
    byId('range').hidden = !hasTone || !isFalse(wanted);
    byId('auto-label').hidden = !hasTone;
    byId('auto').checked = settings.auto;
    if (Math.abs(settings.stops - middle) > (settings.auto ? NEAR : REACH)) middle = Math.round(settings.stops);
    const slider = byId('stops-slider');
    [slider.min, slider.max, slider.value] = [middle - REACH, middle + REACH, settings.stops];
    fill(byId('stops'), settings.stops.toFixed(2));
    fill(byId('range-low'), quantity(settings.range[0], 3));
    fill(byId('range-high'), quantity(settings.range[1], 3));
    drawLegend();
  }

  function drawLegend() {
    const legend = byId('legend');
    legend.hidden = !isFalse();
    if (legend.hidden) return;
    const { context, width, height } = fitCanvas(byId('legend-strip'));
    const map = MAPS[layer];
    for (let x = 0; x < width; x++) {
      const step = 4 * Math.round((x / Math.max(1, width - 1)) * 255);
      context.fillStyle = `rgb(${map[step]} ${map[step + 1]} ${map[step + 2]})`;
      context.fillRect(x, 0, 1.5, height);
    }
    const [low, high] = range();
    const decades = Math.log10(high / low);
    const labels = [];
    for (let power = Math.ceil(Math.log10(low) - 1e-9); power <= Math.log10(high) + 1e-9; power++) {
      labels.push([Math.log10(10 ** power / low) / decades, layer === 'error' ? `${100 * 10 ** power} %` : powerOfTen(power)]);
    }
    // If the scale contains fewer than two powers of ten, label its ends.
    if (labels.length < 2) labels.splice(0, labels.length, [0, quantity(low, 2)], [1, quantity(high, 2)]);
    byId('legend-labels').replaceChildren(...labels.map(([place, text]) => {
      const label = make('span', text);
      label.style.left = `${100 * place}%`;
      return label;
    }));
    byId('legend-title').textContent = layer === 'error' ? 'Standard error / radiance (luminance)'
      : layer === 'depth' ? 'Distance from the camera in m' : `${latest?.isDifference ? 'Difference' : 'Radiance'} in W/(m² sr) (luminance)`;
  }

  function change(by) {
    by();
    show();
    onChange();
  }
  const byHand = by => change(() => { settings.auto = false; by(); });

  byId('stops-slider').addEventListener('input', event => byHand(() => { settings.stops = Number(event.target.value); }));
  onEdit(byId('stops'), text => byHand(() => {
    if (text !== '' && Number.isFinite(Number(text))) settings.stops = Math.max(-126, Math.min(126, Number(text)));
  }), show);
  for (const [id, end] of [['range-low', 0], ['range-high', 1]]) {
    onEdit(byId(id), text => byHand(() => {
      const next = settings.range.with(end, Number(text));
      if (next[0] > 0 && next[1] > next[0]) settings.range = next;
    }), show);
  }
  byId('auto').addEventListener('change', event => change(() => {
    settings.auto = event.target.checked;
    revision = -1;
    if (settings.auto && latest) follow(latest);
  }));
  onChoice('tone', () => change(() => {}));
  onChoice('layer', wanted => change(() => onLayer(wanted)));

  show();
  return {
    show,
    layer: () => chosen('layer'),
    /** A new picture has arrived. */
    take(frame) {
      latest = frame;
      layer = frame.layer;
      follow(frame);
      show();
    },
    /** What a painter needs to know about colours. */
    mapping(frame) {
      const falseColour = isFalse();
      return { falseColour, range: range(), factor: frame.scale * (falseColour || layer === 'normal' ? 1 : 2 ** settings.stops) };
    },
    useLayer(wanted) {
      choose('layer', wanted);
      show();
    },
  };
}

/** 10 to this power, with the power in superscript. */
const powerOfTen = power => `10${[...String(power)].map(digit => (digit === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[digit])).join('')}`;
