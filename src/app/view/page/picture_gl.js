// Draws the picture with WebGL2. The texture holds the half floats; the shader maps them to colours.

import { MAPS } from './colours.js';

const VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0; // One triangle that covers the stage.
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D picture;
uniform sampler2D map;
uniform vec2 stage;       // Size of the stage in pixels of the screen.
uniform vec2 corner;      // Top left corner of the image on it.
uniform float zoom;       // Pixels of the screen per pixel of the image.
uniform vec2 image;       // Size of the image in pixels; the picture may have fewer.
uniform bool smooth_;     // Interpolate.
uniform bool false_colour;
uniform float factor;     // From half floats to the exposed value, or to radiance for false colours.
uniform vec2 range;       // Natural logarithms of the ends of the scale.
uniform float grid;       // Opacity of the pixel grid.
uniform vec3 background;
out vec4 colour;

vec3 fetch(vec2 place) {
  vec2 uv = place / image;
  vec2 size = vec2(textureSize(picture, 0));
  return smooth_ ? texture(picture, uv).rgb : texelFetch(picture, ivec2(clamp(uv * size, vec2(0.0), size - 1.0)), 0).rgb;
}

vec3 srgb(vec3 v) {
  v = clamp(v, 0.0, 1.0);
  return mix(12.92 * v, 1.055 * pow(v, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, v));
}

void main() {
  vec2 place = (vec2(gl_FragCoord.x, stage.y - gl_FragCoord.y) - corner) / zoom;
  if (any(lessThan(place, vec2(0.0))) || any(greaterThanEqual(place, image))) {
    colour = vec4(background, 1.0);
    return;
  }
  // Where a pixel of the screen covers several pixels of the image, it shows their mean.
  int n = int(clamp(ceil(1.0 / zoom - 0.01), 1.0, 4.0));
  vec3 sum = vec3(0.0);
  for (int j = 0; j < n; j++) {
    for (int i = 0; i < n; i++) {
      sum += fetch(place + ((vec2(i, j) + 0.5) / float(n) - 0.5) / zoom);
    }
  }
  vec3 value = sum * (factor / float(n * n));
  if (any(isnan(value))) value = vec3(0.0);
  vec3 shown;
  if (false_colour) {
    float y = dot(value, vec3(0.2126, 0.7152, 0.0722));
    float t = clamp((log(y) - range.x) / (range.y - range.x), 0.0, 1.0);
    shown = y > 0.0 ? texelFetch(map, ivec2(int(t * 255.0 + 0.5), 0), 0).rgb : vec3(0.0);
  } else {
    shown = srgb(value);
  }
  vec2 within = fract(place) * zoom;
  if (grid > 0.0 && min(within.x, within.y) < 1.0) {
    shown = mix(shown, vec3(dot(shown, vec3(0.333)) > 0.5 ? 0.0 : 1.0), grid);
  }
  colour = vec4(shown, 1.0);
}`;

const UNIFORMS = ['picture', 'map', 'stage', 'corner', 'zoom', 'image', 'smooth_', 'false_colour', 'factor', 'range', 'grid', 'background'];

/**
 * Returns a painter { upload, draw }, or null if the browser has no WebGL2. Throws if its WebGL2 cannot draw. `onRestored` is called when
 * the picture must be drawn again because the browser had lost it.
 */
export function makeGlPainter(canvas, { onRestored }) {
  const gl = canvas.getContext('webgl2', { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: false });
  if (!gl) return null;
  const largest = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  let kit = null;
  let latest = null;

  function prepare() {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getProgramInfoLog(program) || 'the shader of the picture does not link');
    }
    gl.useProgram(program);
    const places = Object.fromEntries(UNIFORMS.map(name => [name, gl.getUniformLocation(program, name)]));
    const texture = unit => {
      const made = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, made);
      for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, unit ? gl.NEAREST : gl.LINEAR);
      for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
      return made;
    };
    kit = { places, map: texture(1), picture: texture(0), layer: null };
    gl.uniform1i(places.picture, 0);
    gl.uniform1i(places.map, 1);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  }

  function upload(frame) {
    latest = frame;
    gl.activeTexture(gl.TEXTURE0);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, frame.width, frame.height, 0, gl.RGB, gl.HALF_FLOAT, frame.half);
    if (kit.layer !== frame.layer) {
      gl.activeTexture(gl.TEXTURE1);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, MAPS[frame.layer]);
      kit.layer = frame.layer;
    }
  }

  prepare();
  canvas.addEventListener('webglcontextlost', event => event.preventDefault());
  canvas.addEventListener('webglcontextrestored', () => {
    prepare();
    if (latest) upload(latest);
    onRestored();
  });

  return {
    name: 'WebGL2',
    /** Whether a picture of this size fits into a texture. */
    takes: frame => Math.max(frame.width, frame.height) <= largest,
    upload,
    /** Draws the last picture. `how` is described in picture.js. */
    draw(how) {
      const { places } = kit;
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.uniform2f(places.stage, canvas.width, canvas.height);
      gl.uniform2f(places.corner, how.left, how.top);
      gl.uniform1f(places.zoom, how.zoom);
      gl.uniform2f(places.image, ...how.image);
      gl.uniform1i(places.smooth_, how.smooth ? 1 : 0);
      gl.uniform1i(places.false_colour, how.falseColour ? 1 : 0);
      gl.uniform1f(places.factor, how.factor);
      gl.uniform2f(places.range, ...how.range.map(Math.log));
      gl.uniform1f(places.grid, how.grid);
      gl.uniform3f(places.background, ...how.background.map(byte => byte / 255));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    },
  };
}
