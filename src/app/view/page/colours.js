// From radiance to colours of the screen: the sRGB curve, false colours, and automatic ranges.

import { HALF } from './frame.js';

/** The automatic exposure brings this quantile of the lit pixels' luminance to BRIGHT, as `render --png` does. */
const QUANTILE = 0.97;
const BRIGHT = 0.9;
/** At most this many pixels are examined. */
const EXAMINED = 65536;
/** The automatic scale of false colours ends at this quantile, and begins at most this many decades below. */
const TOP_QUANTILE = 0.995;
const BOTTOM_QUANTILE = 0.02;
const MOST_DECADES = 4;

/** Range of the relative error: 0.1 % to 100 %. It is fixed, so that pictures can be compared over time. */
export const ERROR_RANGE = [1e-3, 1];

export const luminance = (r, g, b) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

/** Sorted luminances of the lit pixels; of large pictures, only every n-th pixel. */
function sortedLuminances({ half, width, height, scale }) {
  const pixels = width * height;
  // In most pictures, an odd stride samples different columns in each row.
  const stride = pixels <= EXAMINED ? 1 : Math.ceil(pixels / EXAMINED) | 1;
  const found = new Float32Array(Math.ceil(pixels / stride));
  let count = 0;
  for (let pixel = 0; pixel < pixels; pixel += stride) {
    const at = 3 * pixel;
    const value = luminance(HALF[half[at]], HALF[half[at + 1]], HALF[half[at + 2]]) * scale;
    if (value > 0 && value < Infinity) found[count++] = value;
  }
  return found.subarray(0, count).sort();
}

const quantile = (sorted, q) => sorted[Math.round((sorted.length - 1) * q)];

/** The automatic exposure of a picture in EV, and the range of its false colours. Returns null for a black picture. */
export function automatic(frame) {
  const sorted = sortedLuminances(frame);
  if (sorted.length === 0) return null;
  const high = quantile(sorted, TOP_QUANTILE);
  const low = Math.max(quantile(sorted, BOTTOM_QUANTILE), high / 10 ** MOST_DECADES);
  return { stops: Math.log2(BRIGHT / quantile(sorted, QUANTILE)), range: [Math.min(low, high / 1.5), high] };
}

/** The sRGB transfer curve of a linear value, clamped to [0, 1]; NaN gives 0. */
export function srgb(linear) {
  if (!(linear > 0)) return 0;
  return linear <= 0.0031308 ? 12.92 * linear : Math.min(1, 1.055 * Math.min(1, linear) ** (1 / 2.4) - 0.055);
}

// Polynomials that fit the colour maps viridis (radiance) and inferno (error) of matplotlib, by Matt Zucker (public domain).
const VIRIDIS = [
  [0.2777273272, 0.0054073445, 0.3340998053], [0.105093043, 1.40461353, 1.384590163],
  [-0.330861829, 0.21484756, 0.095095163], [-4.634230499, -5.799100973, -19.332440956],
  [6.228269936, 14.179933367, 56.690552601], [4.776384998, -13.745145378, -65.353032633],
  [-5.435455856, 4.645852612, 26.312435249],
];
const INFERNO = [
  [0.0002189404, 0.0016510046, -0.0194808984], [0.106513419, 0.563956437, 3.932712389],
  [11.602493082, -3.972853966, -15.942394106], [-41.703996131, 17.436398882, 44.354145199],
  [77.162935699, -33.402358942, -81.807309257], [-71.319428245, 32.626064264, 73.20951986],
  [25.131126225, -12.242668952, -23.070325003],
];

const STEPS = 256;

/** A colour map as STEPS colours of four bytes, R, G, B, 255. */
function table(polynomial) {
  const bytes = new Uint8Array(4 * STEPS).fill(255);
  for (let step = 0; step < STEPS; step++) {
    const t = step / (STEPS - 1);
    for (let channel = 0; channel < 3; channel++) {
      const value = polynomial.reduceRight((sum, term) => sum * t + term[channel], 0);
      bytes[4 * step + channel] = Math.round(255 * Math.min(1, Math.max(0, value)));
    }
  }
  return bytes;
}

/** Colour maps by layer. */
export const MAPS = { mean: table(VIRIDIS), error: table(INFERNO), depth: table(VIRIDIS), normal: table(VIRIDIS) };

/** Position (0 to 1) of a value on a logarithmic scale; less than 0 if the value is not positive. */
export function placeOnScale(value, [low, high]) {
  if (!(value > 0)) return -1;
  return Math.min(1, Math.max(0, Math.log(value / low) / Math.log(high / low)));
}

/** Index into a colour map for a position on the scale. */
export const stepOf = place => Math.round(place * (STEPS - 1));
