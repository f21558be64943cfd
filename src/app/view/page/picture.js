// The picture on the stage: painter, zoom, pixel grid, and the marker of the held (selected) pixel.

import { makeCompare } from './compare.js';
import { byId, fitCanvas, onceAFrame } from './dom.js';
import { makeGlPainter } from './picture_gl.js';
import { make2dPainter } from './picture_2d.js';
import { makeView } from './view.js';

/** Grey around the picture, as in style.css. */
const BACKGROUND = [24, 24, 24];
/** The pixel grid is drawn from this zoom on (pixels of the screen per pixel of the image), with this opacity. */
const GRID_FROM = 10;
const GRID_OPACITY = 0.16;

/**
 * `display` maps values to colours. With `without3d`, the 2D canvas is used even if there is WebGL2.
 *
 * A painter draws with these values: left, top (corner of the image on the stage) and zoom in pixels of the screen; image (its size
 * in pixels); smooth (interpolate); falseColour, range (of radiance), factor (on half floats); grid (opacity); background.
 */
export function makePicture({ display, without3d, onProblem }) {
  const stage = byId('stage');
  const { canvas, painter } = choosePainter(byId('picture'), without3d, () => draw());
  canvas.dataset.painter = painter.name;
  let frame = null; // The newest picture.
  let shown = null; // What is shown: this picture, or a comparison with an earlier one.
  let held = null;
  const compare = makeCompare({ latest: () => frame, onChange: () => { if (frame) paint(); } });

  const draw = onceAFrame(() => {
    const { zoom, left, top, image } = view.now;
    const ratio = window.devicePixelRatio || 1;
    if (shown) {
      byId('zoom').textContent = `${Math.round(100 * zoom * ratio)} %`;
      const isWhole = shown.width === image[0] && shown.height === image[1];
      painter.draw({
        // Pixels of the image begin at pixels of the screen.
        left: Math.round(left * ratio), top: Math.round(top * ratio), zoom: zoom * ratio, image, background: BACKGROUND,
        // A coarse picture has fewer pixels than the image: it is interpolated.
        smooth: !isWhole,
        grid: isWhole && zoom * ratio >= GRID_FROM ? GRID_OPACITY : 0,
        ...display.mapping(shown),
      });
      // For those who watch the page from outside: what is on the screen.
      Object.assign(canvas.dataset, { revision: shown.revision, samples: shown.samples, size: `${shown.width}x${shown.height}` });
      canvas.dataset.layer = shown.layer;
      canvas.dataset.response = shown.response;
    }
    drawMarker(zoom, left, top);
  });
  const view = makeView(draw);

  function paint() {
    shown = compare.apply(frame);
    painter.upload(shown);
    display.take(shown);
    draw();
  }

  function drawMarker(zoom, left, top) {
    const { context } = fitCanvas(byId('overlay'));
    if (!held) return;
    const size = Math.max(zoom, 7);
    const [x, y] = held.map((place, axis) => [left, top][axis] + (place + 0.5) * zoom);
    for (const [colour, width] of [['#000', 3], ['#fff', 1]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.strokeRect(x - size / 2, y - size / 2, size, size);
    }
  }

  function measure(image = view.now.image) {
    const { width, height } = stage.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1;
    // Resizing clears the canvas, so resize it only if its size has changed.
    const pixels = [width, height].map(size => Math.max(1, Math.round(size * ratio)));
    if (canvas.width !== pixels[0] || canvas.height !== pixels[1]) [canvas.width, canvas.height] = pixels;
    view.resize(image, [width, height]);
    draw();
  }
  new ResizeObserver(() => measure()).observe(stage);
  // On another screen, or with another zoom of the browser, the stage may have the same size in CSS pixels.
  function watchRatio() {
    const query = matchMedia(`(resolution: ${window.devicePixelRatio || 1}dppx)`);
    query.addEventListener('change', () => { measure(); watchRatio(); }, { once: true });
  }
  watchRatio();

  return {
    view,
    draw,
    frame: () => frame,
    /** The picture A, if it is compared with the newest one; else null. */
    kept: () => compare.kept(frame),
    setResolution: resolution => measure(resolution),
    take(next) {
      if (!painter.takes(next)) {
        onProblem(`This browser cannot show ${next.width} x ${next.height} pixels with WebGL2; add ?2d to the address, or set a smaller resolution.`);
        return;
      }
      frame = next;
      paint();
    },
    hold(pixel) {
      held = pixel;
      draw();
    },
    held: () => held,
  };
}

/** A painter, WebGL2 if possible, and the canvas on which it paints. */
function choosePainter(canvas, without3d, onRestored) {
  try {
    const painter = without3d ? null : makeGlPainter(canvas, { onRestored });
    return { canvas, painter: painter ?? make2dPainter(canvas) };
  } catch {
    // A canvas that was used by WebGL2 has no 2D context.
    const other = canvas.cloneNode();
    canvas.replaceWith(other);
    return { canvas: other, painter: make2dPainter(other) };
  }
}
