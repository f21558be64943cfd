// Units of travel time, and numbers as text.

/** Speed of light in vacuum, metres per nanosecond (exact). */
export const METRES_PER_NS = 0.299792458;

/** Units of the time line: metres of optical path per unit, and how the unit is written. */
export const UNITS = {
  m: { metres: 1, suffix: 'm', name: 'optical path' },
  ns: { metres: METRES_PER_NS, suffix: 'ns', name: 'time' },
  depth: { metres: 2, suffix: 'm', name: 'one-way depth' },
};

const SUFFIXES = { um: 1e-6, mm: 1e-3, cm: 1e-2, m: 1, km: 1e3, ps: METRES_PER_NS / 1e3, ns: METRES_PER_NS, us: METRES_PER_NS * 1e3 };

/** Parses a travel time such as 6.2, 6.2 m or 20.7ns. Returns metres of optical path, or null. */
export function parseTravelTime(text, unit) {
  const match = /^([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*([a-z]*)$/i.exec(text.trim());
  if (!match) return null;
  const [, digits, suffix] = match;
  if (suffix === '') return Number(digits) * UNITS[unit].metres;
  if (!Object.hasOwn(SUFFIXES, suffix)) return null;
  // Only a length can be a one-way depth. A time is always the full travel time.
  const halved = unit === 'depth' && suffix.endsWith('m');
  return Number(digits) * SUFFIXES[suffix] * (halved ? 2 : 1);
}

/** A number with at most `digits` significant digits and no needless zeros. */
export const short = (value, digits = 9) => String(Number(value.toPrecision(digits)));

/** Converts a travel time from metres to `unit`; a number without suffix. */
export const inUnit = (metres, unit, digits = 6) => short(metres / UNITS[unit].metres, digits);

/** The change of settings that sets a gate (metres). The text is in the user's unit, so that the command shows the user's numbers. */
export function gateChange(lo, hi, unit) {
  const { suffix } = UNITS[unit];
  const end = value => (value === Infinity ? 'inf' : `${inUnit(value, unit, 8)}${suffix}`);
  return { [unit === 'depth' ? 'depth' : 'gate']: `${end(lo)}..${end(hi)}` };
}

/** The change of settings that sets `count` gates between `lo` and `hi` (metres). */
export function gatesChange(lo, hi, count, unit) {
  const { gate, depth } = gateChange(lo, hi, unit === 'depth' ? 'm' : unit);
  return { gates: `${gate ?? depth}/${count}` };
}

/** The gate in all three units, as `taugate` writes it. */
export function describeGate(lo, hi) {
  const span = unit => `${inUnit(lo, unit)}–${hi === Infinity ? '∞' : inUnit(hi, unit)}`;
  return `${span('m')} m = ${span('ns')} ns = ${span('depth')} m depth`;
}

/** A step of 1, 2 or 5 times a power of ten that divides `span` into about `parts` parts. */
export function niceStep(span, parts) {
  const raw = span / parts;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find(factor => factor * power >= raw * 0.999);
  return step * power;
}

/** A physical quantity with four significant digits; exponents for very small and very large numbers. */
export function quantity(value, digits = 4) {
  if (value === 0) return '0';
  if (!Number.isFinite(value)) return Number.isNaN(value) ? 'NaN' : 'inf';
  const size = Math.abs(value);
  return size < 1e-3 || size >= 1e5 ? value.toExponential(digits - 1) : value.toPrecision(digits);
}

/** A quantity with its standard error, rounded to two digits of the error. Without an error, as `quantity`. */
export function withError(value, error) {
  if (!(error > 0) || !Number.isFinite(value + error)) return quantity(value);
  const size = Math.max(Math.abs(value), error);
  const power = size < 1e-3 || size >= 1e5 ? Math.floor(Math.log10(size)) : 0;
  const decimals = Math.max(0, Math.min(8, 1 - Math.floor(Math.log10(error / 10 ** power))));
  const text = `${(value / 10 ** power).toFixed(decimals)} ± ${(error / 10 ** power).toFixed(decimals)}`;
  return power === 0 ? text : `(${text})e${power}`;
}

/** A number with the prefix k, M or G. */
export function withPrefix(value) {
  for (const [factor, prefix] of [[1e9, 'G'], [1e6, 'M'], [1e3, 'k']]) {
    if (value >= factor) return `${(value / factor).toPrecision(3)} ${prefix}`;
  }
  return value.toPrecision(3);
}

/** A duration in seconds, such as 2.1 s, 3 min 20 s or 5 h 2 min. */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return 'never';
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  if (whole < 48 * 3600) return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
  return `${Math.round(whole / 86400)} days`;
}
