// Saving the image on the machine of the program, and the command that makes the same image.

import { byId, make } from './dom.js';

const LISTED = 5;

export function makeSave(link, { samples }) {
  const name = byId('save-name');
  let state = null;
  let isOwnName = false;

  name.addEventListener('input', () => { isOwnName = name.value.trim() !== ''; });
  for (const button of document.querySelectorAll('[data-save]')) {
    button.addEventListener('click', () => {
      const stem = name.value.trim().replace(/\.(exr|png|npy|json)$/i, '');
      link.save(`${stem || 'out'}${button.dataset.save}`);
    });
  }
  // Enter in the name field saves an EXR file.
  name.addEventListener('keydown', event => {
    if (event.key === 'Enter') document.querySelector('[data-save=".exr"]').click();
  });

  /** The complete command, with the number of samples so far and an output. */
  const command = () => {
    // An EXR file holds at most 64 gates.
    const file = state?.responses.length > 64 ? 'out.npy' : 'out.exr';
    return state?.command ? `${state.command} --spp ${Math.max(1, samples())} -o ${file}` : '';
  };
  const show = () => {
    const text = command() || (state ? 'No command can make this image: its experiment has settings that no flag gives.' : '');
    byId('copy').disabled = !command() || samples() === 0;
    // Replacing the text would remove the selection of the user.
    if (byId('command').textContent === text || !getSelection().isCollapsed) return;
    // Lines break between flags, not inside them.
    byId('command').replaceChildren(...text.split(/(?= --)/).flatMap((part, k) => (k ? [' ', make('span', part.trim())] : [part])));
  };

  byId('copy').addEventListener('click', async () => {
    show();
    const isCopied = await copy(command());
    byId('copied').textContent = isCopied ? 'Copied' : 'Copy the text below with the keyboard';
    setTimeout(() => { byId('copied').textContent = ''; }, 4000);
  });

  link.on('welcome', welcome => {
    byId('folder').textContent = `Into ${welcome.folder}; nothing is overwritten.`;
    if (!isOwnName) name.value = welcome.scene.replace(/^.*[\\/]/, '').replace(/\.[^.]*$/, '')
      .replace(/[^A-Za-z0-9._-]+/g, '-').replace(/^[^A-Za-z0-9]+/, '') || 'out';
  });
  link.on('state', next => { state = next; show(); });
  link.on('progress', show);
  link.on('saved', ({ files }) => {
    const list = byId('saved');
    list.prepend(...files.map(file => make('li', `Saved ${file}`)));
    while (list.children.length > LISTED) list.lastChild.remove();
  });
}

/** Copies text. Returns whether it worked. Without https on another machine there is no clipboard, so selects the text instead. */
async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    getSelection().selectAllChildren(byId('command'));
    return document.execCommand('copy');
  }
}
