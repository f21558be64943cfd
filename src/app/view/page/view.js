// Where the picture lies on the stage: zoom and position, both in CSS pixels.

const MOST_ZOOM = 256;
const LEAST_ZOOM = 1 / 64;
/** At least this many CSS pixels of the picture stay on the stage. */
const MARGIN = 40;
/** If the zoom that fits the picture exceeds an integer by less than this factor, the zoom is this integer. */
const NEARLY = 1.08;

/** Pixels of the screen per CSS pixel. */
const screen = () => window.devicePixelRatio || 1;

/** Maps pixels of the image to the stage. `onChange` is called after each change. */
export function makeView(onChange) {
  const view = { zoom: 1, left: 0, top: 0, fits: true, image: [1, 1], stage: [1, 1] };

  function settle() {
    for (const [axis, key] of [[0, 'left'], [1, 'top']]) {
      const size = view.image[axis] * view.zoom;
      view[key] = Math.min(view.stage[axis] - MARGIN, Math.max(MARGIN - size, view[key]));
    }
    onChange();
  }

  function fit() {
    const ratios = [0, 1].map(axis => view.stage[axis] / view.image[axis]);
    view.zoom = Math.min(MOST_ZOOM, Math.max(LEAST_ZOOM, Math.min(...ratios)));
    // With an integer zoom, all pixels of the image have the same size on the screen.
    const whole = Math.floor(view.zoom * screen());
    if (whole >= 1 && view.zoom * screen() < whole * NEARLY) view.zoom = whole / screen();
    view.fits = true;
    centre();
  }

  function centre() {
    view.left = Math.round((view.stage[0] - view.image[0] * view.zoom) / 2);
    view.top = Math.round((view.stage[1] - view.image[1] * view.zoom) / 2);
    settle();
  }

  return {
    get now() { return view; },
    fit,
    /** A new size of the image or of the stage keeps the picture fitted, or its centre in place. */
    resize(image, stage) {
      if ([0, 1].every(axis => image[axis] === view.image[axis] && stage[axis] === view.stage[axis])) return;
      const middle = [0, 1].map(axis => (view.stage[axis] / 2 - [view.left, view.top][axis]) / (view.image[axis] * view.zoom));
      const width = view.image[0] * view.zoom;
      [view.image, view.stage] = [image, stage];
      if (view.fits) return fit();
      view.zoom = width / image[0]; // The picture keeps its width on the stage.
      view.left = stage[0] / 2 - middle[0] * image[0] * view.zoom;
      view.top = stage[1] / 2 - middle[1] * image[1] * view.zoom;
      settle();
    },
    /** One pixel of the image per pixel of the screen. */
    oneToOne() {
      view.zoom = 1 / screen();
      view.fits = false;
      centre();
    },
    /** Zooms about a point of the stage, by default its centre. */
    zoomBy(factor, x = view.stage[0] / 2, y = view.stage[1] / 2) {
      const zoom = Math.min(MOST_ZOOM, Math.max(LEAST_ZOOM, view.zoom * factor));
      view.left = x - (x - view.left) * (zoom / view.zoom);
      view.top = y - (y - view.top) * (zoom / view.zoom);
      view.zoom = zoom;
      view.fits = false;
      settle();
    },
    moveBy(dx, dy) {
      view.left += dx;
      view.top += dy;
      view.fits = false;
      settle();
    },
    /** The pixel of the image under a point of the stage, or null. */
    pixelAt(x, y) {
      const pixel = [Math.floor((x - view.left) / view.zoom), Math.floor((y - view.top) / view.zoom)];
      return [0, 1].every(axis => pixel[axis] >= 0 && pixel[axis] < view.image[axis]) ? pixel : null;
    },
  };
}
