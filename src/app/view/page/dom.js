// Small helpers for elements of the page.

export const byId = id => document.getElementById(id);

/** A new element with text. Data from the server become text, never markup. */
export function make(tag, text = '', className = '') {
  const element = document.createElement(tag);
  element.textContent = text;
  if (className) element.className = className;
  return element;
}

/** The value of the checked radio button of a group. */
export const chosen = name => document.querySelector(`input[name="${name}"]:checked`)?.value;

export function choose(name, value) {
  for (const radio of document.querySelectorAll(`input[name="${name}"]`)) radio.checked = radio.value === value;
}

export function onChoice(name, handler) {
  for (const radio of document.querySelectorAll(`input[name="${name}"]`)) {
    radio.addEventListener('change', () => radio.checked && handler(radio.value));
  }
}

/** Sets the value of a field, except while the user is typing in it. */
export function fill(field, value) {
  if (field.dataset.typing && document.activeElement === field) return;
  field.value = value;
}

/** Calls `handler` with the value of a field when the user has changed it. Escape calls `restore`. */
export function onEdit(field, handler, restore = () => {}) {
  field.addEventListener('input', () => { field.dataset.typing = 'yes'; });
  field.addEventListener('change', () => {
    delete field.dataset.typing;
    handler(field.value.trim());
  });
  field.addEventListener('keydown', event => {
    if (event.key !== 'Escape') return;
    delete field.dataset.typing;
    restore();
  });
}

/** Replaces the options of a <select>; each option is a text, or [value, text]. */
export function setOptions(select, options) {
  select.replaceChildren(...options.map(option => {
    const [value, text] = Array.isArray(option) ? option : [option, option];
    const element = make('option', text);
    element.value = value;
    return element;
  }));
}

/** Gives a canvas one pixel per pixel of the screen. Returns its 2D context, scaled to CSS pixels, and its size in CSS pixels. */
export function fitCanvas(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { width, height } = canvas.getBoundingClientRect();
  const pixels = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
  if (canvas.width !== pixels[0] || canvas.height !== pixels[1]) [canvas.width, canvas.height] = pixels;
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = '11px system-ui, sans-serif';
  return { context, width, height };
}

/** Returns a function that calls `draw`, but at most once per frame of the screen. */
export function onceAFrame(draw) {
  let waiting = false;
  return () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  };
}
