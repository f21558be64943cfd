// Draws the picture with a 2D canvas, for browsers without WebGL2: the same colours, computed here.

import { MAPS, luminance, placeOnScale, srgb, stepOf } from './colours.js';
import { HALF } from './frame.js';

/** The sRGB curve has one table entry per step; 12 bits are more than 8-bit colours can show. */
const CURVE_STEPS = 4096;
const CURVE = Uint8ClampedArray.from({ length: CURVE_STEPS + 1 }, (_, step) => 255 * srgb(step / CURVE_STEPS));

/** Returns a painter like that of picture_gl.js. */
export function make2dPainter(canvas) {
  const context = canvas.getContext('2d', { alpha: false });
  const small = document.createElement('canvas');
  let frame = null;
  let mapped = '';

  /** Maps all values to colours, if the mapping has changed since the last time. */
  function map({ falseColour, factor, range }) {
    const key = [frame.number, frame.layer, falseColour, factor, ...range].join(' ');
    if (key === mapped) return;
    mapped = key;
    [small.width, small.height] = [frame.width, frame.height];
    const target = small.getContext('2d', { alpha: false });
    const image = target.createImageData(frame.width, frame.height);
    const { half } = frame;
    const bytes = image.data;
    const scale = MAPS[frame.layer];
    for (let pixel = 0, from = 0, to = 0; pixel < frame.width * frame.height; pixel++, from += 3, to += 4) {
      bytes[to + 3] = 255;
      const [r, g, b] = [HALF[half[from]] * factor, HALF[half[from + 1]] * factor, HALF[half[from + 2]] * factor];
      if (falseColour) {
        const place = placeOnScale(luminance(r, g, b), range);
        if (place < 0) continue; // Black.
        const step = 4 * stepOf(place);
        for (let channel = 0; channel < 3; channel++) bytes[to + channel] = scale[step + channel];
      } else {
        bytes[to] = curve(r);
        bytes[to + 1] = curve(g);
        bytes[to + 2] = curve(b);
      }
    }
    target.putImageData(image, 0, 0);
  }

  return {
    name: '2D canvas',
    takes: () => true,
    upload(next) {
      frame = next;
    },
    draw(how) {
      context.fillStyle = `rgb(${how.background.join(' ')})`;
      context.fillRect(0, 0, canvas.width, canvas.height);
      if (!frame) return;
      map(how);
      context.imageSmoothingEnabled = how.smooth || how.zoom < 1;
      const [width, height] = how.image.map(size => size * how.zoom);
      context.drawImage(small, how.left, how.top, width, height);
      if (how.grid > 0) drawGrid(how, width, height);
    },
  };

  function drawGrid(how, width, height) {
    context.strokeStyle = `rgb(128 128 128 / ${how.grid + 0.2})`;
    context.beginPath();
    for (let x = Math.max(0, Math.floor(-how.left / how.zoom)); x <= how.image[0]; x++) {
      const at = Math.round(how.left + x * how.zoom) + 0.5;
      if (at > canvas.width) break;
      context.moveTo(at, Math.max(0, how.top));
      context.lineTo(at, Math.min(canvas.height, how.top + height));
    }
    for (let y = Math.max(0, Math.floor(-how.top / how.zoom)); y <= how.image[1]; y++) {
      const at = Math.round(how.top + y * how.zoom) + 0.5;
      if (at > canvas.height) break;
      context.moveTo(Math.max(0, how.left), at);
      context.lineTo(Math.min(canvas.width, how.left + width), at);
    }
    context.stroke();
  }
}

function curve(linear) {
  if (!(linear > 0)) return 0;
  if (linear >= 1) return 255;
  // Near black the curve is steep, so the table would be too coarse there.
  return linear < 0.02 ? Math.round(255 * srgb(linear)) : CURVE[Math.round(linear * CURVE_STEPS)];
}
