// The settings beside the picture: camera, emitters, estimator. Each control sets one flag of `taugate render`.

import { cameraChange, cameraOf, distance, placeText, viewHeight } from './camera.js';
import { byId, fill, make, onEdit, setOptions } from './dom.js';
import { short } from './units.js';

/** Fields that set the flag of the same name; an empty field leaves the flag out. */
const PLAIN = ['max-depth', 'queries', 'seed', 'sampling', 'headlamp'];

export function makePanel(link, steering, { onProblem }) {
  let latest = null;
  let known = [];

  const restore = () => latest && follow(latest);

  for (const key of PLAIN) onEdit(byId(key), text => link.set({ [key]: text === '' ? false : text }), restore);
  for (const key of ['look-from', 'look-at']) {
    // Also sends the rest of the camera that the page shows. The program would choose a target itself.
    const place = text => ({ ...cameraChange(cameraOf(latest)), [key]: text.replace(/[\s,]+/g, ',') });
    onEdit(byId(key), text => link.set(text === '' ? { [key]: null } : place(text)), restore);
  }
  onEdit(byId('camera'), name => link.set({ camera: name }));
  byId('camera-reset').addEventListener('click', () => steering.reset());
  onEdit(byId('estimator'), name => link.set({ estimator: name === '' ? false : name }));
  byId('double-sided').addEventListener('change', event => link.set({ 'double-sided': event.target.checked }));

  // The new projection shows the same part of the plane through the target.
  onEdit(byId('projection'), kind => {
    const camera = cameraOf(latest);
    const height = viewHeight(camera);
    const away = Math.hypot(...camera.look_at.map((value, axis) => value - camera.look_from[axis]));
    const degrees = (360 / Math.PI) * Math.atan(height / 2 / away);
    link.set(kind === 'ortho' ? { ortho: short(height, 4) } : { fov: short(degrees, 4) });
  });
  onEdit(byId('view-angle'), text => link.set({ [byId('projection').value]: text === '' ? null : text }), restore);

  onEdit(byId('aperture'), text => {
    // At first, the target is in focus.
    const focus = latest.settings.focus ?? short(distance(cameraOf(latest)), 4);
    link.set(text === '' ? { aperture: false, focus: false, blades: false } : { aperture: text, focus });
  }, restore);
  onEdit(byId('focus'), text => (text === '' ? restore() : link.set({ focus: text })), restore);

  const setResolution = (width, height) => {
    if (width > 0 && height > 0) link.set({ resolution: `${Math.max(1, Math.round(width))}x${Math.max(1, Math.round(height))}` });
    else restore();
  };
  onEdit(byId('width'), text => setResolution(Number(text), latest.resolution[1]), restore);
  onEdit(byId('height'), text => setResolution(latest.resolution[0], Number(text)), restore);
  byId('smaller').addEventListener('click', () => setResolution(...latest.resolution.map(size => size / 2)));
  byId('larger').addEventListener('click', () => setResolution(...latest.resolution.map(size => size * 2)));

  function setEmitters() {
    const boxes = [...byId('emitters').querySelectorAll('input')];
    const on = boxes.filter(box => box.checked).map(box => box.value);
    if (on.length === 0) {
      onProblem('One emitter must be on: without light there is no picture.');
      restore();
    } else {
      link.set({ emitters: on.length === boxes.length ? 'scene' : on.join(',') });
    }
  }

  /** Shows a box per emitter of the scene, and one per emitter that a flag added. */
  function showEmitters(state) {
    const names = [...known, ...state.emitters.filter(name => !known.some(({ node }) => node === name)).map(node => ({ node, kind: '' }))];
    const list = byId('emitters');
    const wanted = JSON.stringify(names);
    if (list.dataset.names !== wanted) {
      list.dataset.names = wanted;
      list.replaceChildren(...names.map(({ node, kind }) => {
        const label = make('label', '', 'check');
        const box = make('input');
        box.type = 'checkbox';
        box.value = node;
        box.addEventListener('change', setEmitters);
        label.append(box, make('span', node), make('span', kind, 'quiet'));
        return label;
      }));
    }
    for (const box of list.querySelectorAll('input')) box.checked = state.emitters.includes(box.value);
  }

  function follow(state) {
    latest = state;
    const { settings } = state;
    const camera = cameraOf(state);
    const option = [...byId('camera').options].find(({ value }) => value === (settings.camera ?? camera.name));
    byId('camera').value = option?.value ?? '';
    fill(byId('look-from'), placeText(camera, 'look_from'));
    fill(byId('look-at'), placeText(camera, 'look_at'));
    byId('projection').value = camera.ortho ? 'ortho' : 'fov';
    fill(byId('view-angle'), short(camera.ortho ?? camera.fov ?? 0, 4));
    byId('view-angle').setAttribute('aria-label', camera.ortho ? 'Height of the view in metres' : 'Vertical field of view in degrees');
    byId('view-unit').textContent = camera.ortho ? 'm' : '°';
    fill(byId('aperture'), settings.aperture ?? '');
    byId('aperture').disabled = Boolean(camera.ortho);
    fill(byId('focus'), settings.focus ?? '');
    byId('focus').disabled = !settings.aperture;
    fill(byId('width'), state.resolution[0]);
    fill(byId('height'), state.resolution[1]);
    showEmitters(state);
    fill(byId('headlamp'), settings.headlamp ?? '');
    byId('estimator').value = settings.estimator ?? '';
    byId('estimator').options[0].textContent = settings.estimator ? 'automatic' : `automatic (${state.estimator})`;
    fill(byId('max-depth'), state.max_depth);
    byId('sampling').value = state.sampling;
    fill(byId('queries'), settings.queries ?? '');
    fill(byId('seed'), settings.seed ?? '');
    byId('double-sided').checked = isOn(settings['double-sided']);
  }

  link.on('welcome', welcome => {
    known = welcome.emitters;
    setOptions(byId('camera'), [...welcome.cameras, ['auto', 'automatic']]);
    setOptions(byId('estimator'), [['', 'automatic'], ...welcome.estimators]);
  });
  link.on('state', follow);
  link.on('problem', restore);
}

/** Whether a flag without a value is set. */
export const isOn = value => value === true || value === 'true';
