// relMSE against time, both logarithmic, with a fitted power law.

import { fitCanvas } from './dom.js';

const COLOURS = { axis: '#a6a6a6', grid: '#333333', points: '#6fb3f2', fit: '#e0a33c', target: '#9a9a9a' };
const EDGE = { left: 40, right: 8, top: 6, bottom: 18 };
/** The law is fitted to the points after this fraction of the time; earlier points have not settled. */
const SETTLED = 0.2;
/** If there are more points than this, every second one is dropped. */
const MOST_POINTS = 600;

/** Adds a point [seconds, relMSE] if it is valid and later than the last one; returns whether it did. */
export function addPoint(points, seconds, error) {
  const last = points.at(-1);
  if (!(seconds > 0) || !(error > 0) || (last && seconds <= last[0])) return false;
  points.push([seconds, error]);
  if (points.length > MOST_POINTS) {
    const kept = points.filter((_, k) => k % 2 === 0 || k === points.length - 1);
    points.splice(0, points.length, ...kept);
  }
  return true;
}

/** The power law error = exp(offset) seconds^slope by least squares in logarithms. Null with fewer than four points. */
export function fitLaw(points) {
  const from = SETTLED * (points.at(-1)?.[0] ?? 0);
  const settled = points.filter(([seconds]) => seconds >= from).map(pair => pair.map(Math.log));
  if (settled.length < 4) return null;
  const mean = [0, 1].map(axis => settled.reduce((sum, pair) => sum + pair[axis], 0) / settled.length);
  let [xx, xy] = [0, 0];
  for (const [x, y] of settled) {
    xx += (x - mean[0]) ** 2;
    xy += (x - mean[0]) * (y - mean[1]);
  }
  if (xx < 1e-3) return null;
  const slope = xy / xx;
  return { slope, offset: mean[1] - slope * mean[0] };
}

/** Time at which the error reaches `target`; infinite if the error does not fall. Null without a law. */
export function timeTo(law, target) {
  if (!law) return null;
  return law.slope < -0.05 ? Math.exp((Math.log(target) - law.offset) / law.slope) : Infinity;
}

/** Draws the points, the law up to the target, and the target. */
export function drawPlot(canvas, points, law, target) {
  const { context, width, height } = fitCanvas(canvas);
  context.font = '10px system-ui, sans-serif';
  if (points.length < 2) {
    if (points.length === 1) return;
    context.fillStyle = COLOURS.axis;
    context.textAlign = 'center';
    context.fillText('The error is known after two iterations.', width / 2, height / 2);
    return;
  }
  const reach = timeTo(law, target);
  const [first, last] = [points[0], points.at(-1)];
  // The plot looks ahead to the target, but at most to ten times the time so far.
  const end = Math.max(last[0] * 1.3, Number.isFinite(reach) ? Math.min(reach * 1.1, last[0] * 10) : 0);
  const errors = points.map(([, error]) => error);
  const span = {
    x: [first[0], end].map(Math.log10),
    y: [Math.min(target, ...errors) / 1.6, Math.max(...errors) * 1.6].map(Math.log10),
  };
  const toX = seconds => EDGE.left + ((Math.log10(seconds) - span.x[0]) / (span.x[1] - span.x[0])) * (width - EDGE.left - EDGE.right);
  const toY = error => EDGE.top + ((span.y[1] - Math.log10(error)) / (span.y[1] - span.y[0])) * (height - EDGE.top - EDGE.bottom);

  drawGrid(context, span, toX, toY, width, height);

  context.setLineDash([2, 3]);
  line(context, COLOURS.target, [[EDGE.left, toY(target)], [width - EDGE.right, toY(target)]]);
  if (law) {
    const at = seconds => [toX(seconds), toY(Math.exp(law.offset) * seconds ** law.slope)];
    context.setLineDash([5, 3]);
    line(context, COLOURS.fit, [at(Math.max(first[0], SETTLED * last[0])), at(end)]);
  }
  context.setLineDash([]);
  context.lineWidth = 1.5;
  line(context, COLOURS.points, points.map(([seconds, error]) => [toX(seconds), toY(error)]));
  context.lineWidth = 1;
}

function drawGrid(context, { x, y }, toX, toY, width, height) {
  context.fillStyle = COLOURS.axis;
  context.textAlign = 'center';
  for (const [value, text] of ticks(x)) {
    line(context, COLOURS.grid, [[toX(value), EDGE.top], [toX(value), height - EDGE.bottom]]);
    if (toX(value) < width - 16) context.fillText(`${text} s`, toX(value), height - 5);
  }
  context.textAlign = 'right';
  for (const [value, text] of ticks(y)) {
    line(context, COLOURS.grid, [[EDGE.left, toY(value)], [width - EDGE.right, toY(value)]]);
    context.fillText(text, EDGE.left - 4, toY(value) + 3);
  }
}

/** Ticks in a range of logarithms: powers of ten, and also 2 and 5 times these if there are few. */
function ticks([from, to]) {
  const factors = to - from > 1.6 ? [1] : [1, 2, 5];
  const found = [];
  for (let power = Math.floor(from); power <= Math.ceil(to); power++) {
    for (const factor of factors) {
      const value = factor * 10 ** power;
      const place = Math.log10(value);
      if (place >= from && place <= to) found.push([value, power < -3 || power > 3 ? value.toExponential(0) : String(Number(value.toPrecision(3)))]);
    }
  }
  return found;
}

function line(context, colour, points) {
  context.strokeStyle = colour;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}
