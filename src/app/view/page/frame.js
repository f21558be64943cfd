// Pictures as the server sends them: a header, then half floats.

const HEADER = 40;
export const LAYERS = ['mean', 'error', 'depth', 'normal'];
/** The response of a picture that shows the sum of many gates. */
const SUM = 0xffffffff;

/** Reads a binary message. Returns null if it is not a picture of this protocol. Values are `half * scale`; row 0 is at the top. */
export function parseFrame(buffer) {
  if (buffer.byteLength < HEADER) return null;
  const view = new DataView(buffer);
  if (view.getUint32(0, false) !== 0x54475031) return null; // "TGP1"
  const word = offset => view.getUint32(offset, true);
  const [width, height] = [word(12), word(16)];
  const layer = LAYERS[view.getUint8(24)];
  if (!layer || width * height === 0 || buffer.byteLength !== HEADER + 6 * width * height) return null;
  return {
    number: word(4), revision: word(8), width, height, response: word(20), isSum: word(20) === SUM, layer,
    samples: word(28), scale: view.getFloat32(32, true),
    half: new Uint16Array(buffer, HEADER),
  };
}

/** The values of all half floats: index it with 16 bits. */
export const HALF = (() => {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31;
    const mantissa = bits & 1023;
    let value;
    if (exponent === 0) value = mantissa * 2 ** -24;
    else if (exponent === 31) value = mantissa ? NaN : Infinity;
    else value = (1 + mantissa / 1024) * 2 ** (exponent - 15);
    table[bits] = bits & 32768 ? -value : value;
  }
  return table;
})();

/** The bits of the half float nearest to a value from 0 to 32768. */
export function toHalf(value) {
  if (!(value >= 2 ** -14)) return value > 0 ? Math.round(value * 2 ** 24) : 0;
  const exponent = Math.floor(Math.log2(value));
  // Rounding up may carry into the exponent, as it should.
  return ((exponent + 15) << 10) + Math.round((value / 2 ** exponent - 1) * 1024);
}

/** Red, green and blue at a point of the picture, given as fractions of its width and height. */
export function valueAt(frame, u, v) {
  const x = Math.min(frame.width - 1, Math.floor(u * frame.width));
  const y = Math.min(frame.height - 1, Math.floor(v * frame.height));
  const at = 3 * (y * frame.width + x);
  return [0, 1, 2].map(channel => HALF[frame.half[at + channel]] * frame.scale);
}
