// The medium that fills the scene: fog, smoke or water, by visibility or by coefficients.

import { byId, fill, onEdit } from './dom.js';
import { isOn } from './panel.js';
import { quantity } from './units.js';

const KINDS = { visibility: ['visibility'], mor: ['mor'], sigma: ['sigma-s', 'sigma-a'] };
const FIELDS = ['visibility', 'mor', 'sigma-s', 'sigma-a', 'albedo', 'phase-g'];

export function makeMedium(link) {
  const kind = byId('medium-kind');
  let latest = null;

  function showFields() {
    for (const row of document.querySelectorAll('[data-medium]')) row.hidden = !row.dataset.medium.split(' ').includes(kind.value);
  }

  function follow(state) {
    latest = state;
    const { settings, medium } = state;
    const set = Object.keys(KINDS).find(name => KINDS[name].some(key => settings[key] !== undefined));
    // If no such setting is given, keep the kind that the user has chosen but not filled in yet.
    if (set) kind.value = set;
    else if (!kind.dataset.chosen) kind.value = '';
    for (const key of FIELDS) fill(byId(key), settings[key] ?? '');
    byId('no-medium').checked = isOn(settings['no-medium']);
    byId('medium-text').textContent = medium
      ? `Scattering ${list(medium.sigma_s)} 1/m, absorption ${list(medium.sigma_a)} 1/m` : 'There is no medium.';
    showFields();
  }

  onEdit(kind, value => {
    kind.dataset.chosen = value;
    showFields();
    const isSet = Object.values(KINDS).flat().some(key => latest?.settings[key] !== undefined);
    if (value === '' && isSet) link.set(Object.fromEntries(['visibility', 'mor', 'sigma-s', 'sigma-a', 'albedo'].map(key => [key, false])));
  });
  /** Changes that remove the settings which contradict the setting `key`. */
  const others = key => {
    const own = Object.values(KINDS).find(keys => keys.includes(key));
    if (!own) return {};
    const rest = Object.values(KINDS).flat().filter(other => !own.includes(other));
    if (own === KINDS.sigma) rest.push('albedo');
    return Object.fromEntries(rest.map(other => [other, false]));
  };
  for (const key of FIELDS) {
    onEdit(byId(key), text => link.set(text === '' ? { [key]: false } : { ...others(key), [key]: text }), () => latest && follow(latest));
  }
  byId('no-medium').addEventListener('change', event => link.set({ 'no-medium': event.target.checked }));

  link.on('state', follow);
  link.on('problem', () => latest && follow(latest));
  showFields();
}

const list = values => (new Set(values).size === 1 ? quantity(values[0], 3) : values.map(value => quantity(value, 3)).join(', '));
