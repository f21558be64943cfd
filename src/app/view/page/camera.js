// The camera: turning, moving and flying change its position, its target and its upward direction.

const EPSILON = 1e-9;
/** Minimum angle (radians) between the view direction and the vertical. A smaller angle would let a turn flip the camera. */
const LEAST_ANGLE = 0.02;

const add = (a, b, factor = 1) => a.map((value, axis) => value + factor * b[axis]);
const scaled = (a, factor) => a.map(value => value * factor);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = a => Math.sqrt(dot(a, a));
const unit = a => scaled(a, 1 / Math.max(length(a), EPSILON));

/** Turns `vector` about the unit vector `axis` (Rodrigues' formula). */
function turned(vector, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scaled(vector, c), cross(axis, vector), s), axis, dot(axis, vector) * (1 - c));
}

const UP = [0, 1, 0];
/** A camera is level if the sine of its roll is smaller than this. */
const LEVEL = 1e-4;
/** Cosine of the angle to the vertical above which a view needs the setting `up`: without it, the program turns steep views (of a cosine
 * above 0.999) upright towards +Z. */
const STEEP = 0.99;

const isLevel = (camera, axis) => Math.abs(dot(frameOf(camera).right, axis)) < LEVEL;

/**
 * The vertical, about which the camera turns, as a unit vector. `given` is the setting `up`, and `isPlaced` says whether settings
 * place the camera. The program levels a placed camera with this setting, or else with +Y. The camera of a file is level with an axis
 * of the world; +Y if there is none.
 */
function verticalOf(camera, given, isPlaced) {
  // The upward direction of a camera that is not level with an axis comes from `cameraChange` and is no vertical.
  const isOwn = given && given.every(value => Math.abs(value) < 1 - 1e-6) && Math.abs(dot(unit(given), frameOf(camera).forward)) < LEVEL;
  if (given && !isOwn) return unit(given);
  if (isPlaced && !given) return UP;
  for (const axis of [1, 2, 0]) {
    const direction = [0, 1, 2].map(k => (k === axis ? Math.sign(camera.up[k]) : 0));
    // A camera that looks along one axis may be level with two. It looks rather upwards or downwards than lies on its side.
    if (Math.abs(camera.up[axis]) > 0.25 && isLevel(camera, direction)) return direction;
  }
  return UP;
}

/** Right, up and forward of a camera, as unit vectors. */
function frameOf({ look_from, look_at, up }) {
  const forward = unit(add(look_at, look_from, -1));
  const right = unit(cross(forward, up));
  return { forward, right, up: cross(right, forward) };
}

/** Turns the vector `arm` about the vertical and about the camera's right, by angles in radians; also turns `up`. */
function turn(camera, arm, yaw, pitch) {
  const axis = camera.vertical;
  const { forward, right } = frameOf(camera);
  const angle = Math.acos(Math.max(-1, Math.min(1, dot(forward, axis))));
  const allowed = Math.max(angle - (Math.PI - LEAST_ANGLE), Math.min(angle - LEAST_ANGLE, pitch));
  const apply = vector => turned(turned(vector, right, allowed), axis, yaw);
  return { arm: apply(arm), up: apply(frameOf(camera).up) };
}

export const distance = camera => length(add(camera.look_at, camera.look_from, -1));

/** Turns the camera about its target. Positive yaw moves the scene to the right, positive pitch looks from below. */
export function orbit(camera, yaw, pitch) {
  const { arm, up } = turn(camera, add(camera.look_from, camera.look_at, -1), -yaw, pitch);
  return { ...camera, look_from: add(camera.look_at, arm), up };
}

/** Turns the camera in place: positive yaw to the left, positive pitch upwards. */
export function look(camera, yaw, pitch) {
  const { arm, up } = turn(camera, add(camera.look_at, camera.look_from, -1), yaw, pitch);
  return { ...camera, look_at: add(camera.look_from, arm), up };
}

/** Moves the camera and its target to the right, upwards and forwards; distances in metres. */
export function move(camera, right, upwards, forwards) {
  const axes = frameOf(camera);
  const way = add(add(scaled(axes.right, right), axes.up, upwards), axes.forward, forwards);
  return { ...camera, look_from: add(camera.look_from, way), look_at: add(camera.look_at, way) };
}

/** Divides the distance to the target by `factor`; an orthographic view shows a smaller part of the scene instead. */
export function dolly(camera, factor) {
  if (camera.ortho) return { ...camera, ortho: camera.ortho / factor };
  const arm = add(camera.look_from, camera.look_at, -1);
  return { ...camera, look_from: add(camera.look_at, arm, 1 / factor) };
}

/** Height of the view at the target, in metres. */
export function viewHeight(camera) {
  return camera.ortho ?? 2 * distance(camera) * Math.tan(((camera.fov ?? 40) * Math.PI) / 360);
}

const text = (vector, digits) => vector.map(value => String(Number(value.toFixed(digits)))).join(',');

/** Decimals for lengths: a thousandth of a per cent of the distance to the target. */
const decimals = camera => Math.max(0, Math.min(12, Math.ceil(5 - Math.log10(Math.max(distance(camera), 1e-12)))));

/** A position as text, with as many decimals as the distance to the camera's target needs. */
export const placeText = (camera, key) => text(camera[key], decimals(camera));

/** The camera in a state message, with its `vertical`. A target that the user gave stays where it is. */
export function cameraOf({ camera, settings }) {
  const vector = name => {
    const numbers = settings[name]?.split(',').map(Number);
    return numbers?.length === 3 && numbers.every(Number.isFinite) ? numbers : null;
  };
  const isPlaced = Boolean(settings['look-from'] ?? settings['look-at']);
  return { ...camera, look_at: vector('look-at') ?? camera.look_at, vertical: verticalOf(camera, vector('up'), isPlaced) };
}

/** The setting `up` of `camera`; false for the default of the program, which is +Y unless the view is steep. */
function upOf(camera) {
  const { vertical } = camera;
  if (!isLevel(camera, vertical)) return text(camera.up, 6);
  const isDefault = length(add(vertical, UP, -1)) < 1e-6 && Math.abs(dot(frameOf(camera).forward, UP)) < STEEP;
  return isDefault ? false : text(vertical, 6);
}

/** The change of settings that sets `camera`. */
export function cameraChange(camera) {
  const change = { 'look-from': placeText(camera, 'look_from'), 'look-at': placeText(camera, 'look_at'), up: upOf(camera) };
  if (camera.ortho) change.ortho = String(Number(camera.ortho.toPrecision(6)));
  return change;
}
