// The page of `taugate view`: connects to the program and hands its messages to the parts of the page.

import { byId } from './dom.js';
import { makeDisplay } from './display.js';
import { makeGate } from './gate.js';
import { openLink } from './link.js';
import { makeMedium } from './medium.js';
import { makeMessages } from './messages.js';
import { makePanel } from './panel.js';
import { makePicture } from './picture.js';
import { makeReadout } from './readout.js';
import { makeSave } from './save.js';
import { makeSteering } from './steer.js';
import { makeTools } from './tools.js';
import { makeWork } from './work.js';

// The token is behind #, so neither the browser's request nor a log contains it.
const link = openLink(location.hash.slice(1));
// A new address in the same tab only changes what is behind #.
addEventListener('hashchange', () => location.reload());

const messages = makeMessages(link, { retry: link.connect });
const onProblem = messages.problem;

const ask = () => link.show(display.layer(), gate.model.bin);
const display = makeDisplay({ onChange: () => picture.draw(), onLayer: ask });
const picture = makePicture({ display, without3d: new URLSearchParams(location.search).has('2d'), onProblem });
const gate = makeGate(link, { onBin: () => { ask(); readout.ask(); }, onProblem });
const steering = makeSteering(link);
const readout = makeReadout(link, picture, { onHistogram: gate.showPixel });
const work = makeWork(link);
makeTools({ picture, steering, onPoint: readout.point, onHold: readout.hold, onPause: work.toggle });
makePanel(link, steering, { onProblem });
makeMedium(link);
makeSave(link, { samples: work.samples });

link.on('welcome', ({ scene, device, version }) => {
  byId('scene-name').textContent = scene;
  byId('device').textContent = `${device} · taugate ${version}`;
  document.title = `${scene} – taugate`;
  ask();
});
link.on('state', ({ resolution }) => {
  picture.setResolution(resolution);
  const held = picture.held();
  if (held && held.some((place, axis) => place >= resolution[axis])) readout.hold(null);
});
link.on('picture', frame => {
  link.ack(frame.number);
  picture.take(frame);
});
link.connect();
