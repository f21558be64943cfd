// What the program says: notes, warnings, problems, a failed render, and a lost connection.

import { byId, make } from './dom.js';

export function makeMessages(link, { retry }) {
  const alerts = byId('alerts');
  const cover = byId('cover');
  let revision = -1;
  let failed = null;
  let progress = null;

  /** Shows a sentence above the picture; each `kind` has one line. */
  function say(kind, text, button) {
    clear(kind);
    const line = make('div', '', `alert ${kind}`);
    line.append(make('span', text));
    if (button) line.append(button);
    alerts.append(line);
  }
  const clear = kind => alerts.querySelector(`.${kind}`)?.remove();
  function closeButton(kind) {
    const button = make('button', 'Dismiss');
    button.type = 'button';
    button.addEventListener('click', () => clear(kind));
    return button;
  }

  const problem = text => say('problem', text, closeButton('problem'));

  /** The text that covers the picture. */
  function coverText() {
    if (failed) return failed;
    if (progress?.phase === 'dark') return 'No light arrives in this gate.';
    const shown = byId('picture').dataset;
    // If there is an old picture, it stays visible while the next one is prepared.
    if (progress?.phase === 'preparing' && shown.revision === undefined) return 'Preparing';
    if (progress?.relmse === null && shown.layer === 'error') return 'The error is known after two iterations.';
    return '';
  }

  function showCover() {
    const text = coverText();
    cover.hidden = text === '';
    cover.className = failed ? 'failed' : '';
    // Set only new text, so that screen readers do not announce the same text again.
    if (cover.textContent !== text) cover.textContent = text;
  }

  link.on('connection', ({ open, text, canRetry }) => {
    byId('connection').textContent = open ? 'Connected' : 'Not connected';
    byId('connection').className = open ? 'good' : 'bad';
    document.body.classList.toggle('offline', !open);
    if (open) return clear('lost');
    const button = make('button', 'Try now');
    button.type = 'button';
    button.addEventListener('click', retry);
    say('lost', text, canRetry ? button : null);
  });
  link.on('problem', ({ message }) => problem(message));
  link.on('failed', ({ message }) => { failed = message; showCover(); });
  link.on('progress', next => { progress = next; showCover(); });
  link.on('picture', showCover);
  link.on('state', state => {
    if (state.revision !== revision) {
      revision = state.revision;
      failed = null;
      clear('problem');
    }
    showCover();
    const rows = [...state.warnings.map(text => ['Warning', text]), ...state.notes.map(text => ['Note', text])];
    byId('messages').replaceChildren(...rows.map(([kind, text]) => {
      const row = make('li', '', kind.toLowerCase());
      row.append(make('strong', `${kind}: `), text);
      return row;
    }));
    byId('messages-section').hidden = rows.length === 0;
  });

  return { problem };
}
