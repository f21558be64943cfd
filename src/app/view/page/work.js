// The work: samples, time, rays per second, and how the error falls.

import { byId, onEdit } from './dom.js';
import { addPoint, drawPlot, fitLaw, timeTo } from './plot.js';
import { duration, quantity, withPrefix } from './units.js';

const PHASES = {
  preparing: 'Preparing', coarse: 'First picture', rendering: 'Rendering', paused: 'Paused', done: 'Done', dark: 'No light in this gate',
};

export function makeWork(link) {
  const points = [];
  let revision = -1;
  let paused = false;
  let latest = null;
  let target = 0.001;

  function show() {
    const { phase, samples, min_samples: least, max_samples: most, seconds, rays_per_second: rays, device_share: share, host_share: host, relmse } = latest;
    byId('phase').textContent = PHASES[phase] ?? phase;
    byId('phase').dataset.phase = phase;
    byId('samples').textContent = least === most ? String(samples) : `${samples} (${least} to ${most})`;
    byId('seconds').textContent = duration(seconds);
    byId('rays').textContent = rays > 0 ? withPrefix(rays) : '–';
    byId('device-share').textContent = share > 0 ? `${Math.round(100 * Math.min(1, share))} % / ${Math.round(100 * host)} %` : '–';
    byId('relmse').textContent = relmse === null ? '–' : quantity(relmse, 3);
    const law = fitLaw(points);
    byId('slope').textContent = law ? law.slope.toFixed(2).replace('-', '−') : '–';
    const reach = timeTo(law, target);
    byId('target-time').textContent = relmse !== null && relmse <= target ? 'reached'
      : reach === null ? '' : reach === Infinity ? 'not in sight' : `in ${duration(Math.max(0, reach - seconds))}`;
    drawPlot(byId('plot'), points, law, target);
  }

  link.on('progress', message => {
    if (message.revision !== revision) {
      revision = message.revision;
      points.length = 0;
    }
    latest = message;
    addPoint(points, message.seconds, message.relmse);
    show();
  });
  link.on('state', state => {
    paused = state.paused;
    byId('pause').textContent = paused ? 'Go on' : 'Pause';
    byId('pause').classList.toggle('on', paused);
  });
  const toggle = () => link.pause(!paused);
  byId('pause').addEventListener('click', toggle);
  onEdit(byId('target'), text => {
    if (Number(text) > 0) target = Number(text);
    byId('target').value = String(target);
    if (latest) show();
  }, () => { byId('target').value = String(target); });
  new ResizeObserver(() => latest && show()).observe(byId('plot'));

  return { toggle, samples: () => latest?.samples ?? 0 };
}
