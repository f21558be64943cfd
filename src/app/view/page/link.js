// The connection to the program: messages out, messages in, and connecting again.

import { parseFrame } from './frame.js';

/** First and longest pause (ms) before connecting again. Each pause is twice as long as the one before. */
const FIRST_PAUSE = 500;
const LONGEST_PAUSE = 10000;
/** Time between two messages of the same kind, in ms. */
const SET_EVERY = 30;
const PIXEL_EVERY = 100;
const SHOW_EVERY = 40;
/** If nothing arrives for this time (ms), the connection is dead. The program shows a sign of life every 30 s. */
const SILENCE = 75000;
const LOOK_EVERY = 5000;
/** After this time (ms), the page no longer waits for the answer to a change. */
const ANSWER_WITHIN = 10000;
/** A large picture that the program has announced may take this time (ms) per byte. Also in client.rs. */
const PER_BYTE = 0.016;

/** Close codes after which the page does not connect again by itself, because it would not help. */
const ENDINGS = {
  4401: 'This address has no valid token. Open the address that the program printed; the token is the part after #.',
  4400: 'The program closed the connection because it did not understand this page. Load the page again.',
  1001: 'The program has ended. Start it again, and open the address that it prints.',
};

/**
 * Connects to the program that served this page. `on(kind, handler)` registers a handler for a kind of message (its `is`), or
 * for `picture` and `connection`. A connection is { open, text, canRetry }.
 */
export function openLink(token) {
  const handlers = new Map();
  let socket = null;
  let pause = FIRST_PAUSE;
  let timer = 0;
  let heard = 0;
  let patience = SILENCE;
  // Changes of settings: how many were sent, up to which number they are answered, and when the last one was sent.
  let sent = 0;
  let answered = 0;
  let sentAt = -Infinity;

  const emit = (kind, value) => {
    for (const handler of handlers.get(kind) ?? []) handler(value);
  };
  const send = message => {
    if (socket?.readyState !== WebSocket.OPEN) return false;
    socket.send(JSON.stringify(message));
    return true;
  };

  const set = throttle(SET_EVERY, changes => {
    sentAt = performance.now();
    if (send({ do: 'set', changes, number: sent + 1 })) sent += 1;
  });
  const pixel = throttle(PIXEL_EVERY, place => send({ do: 'pixel', ...place }));
  const show = throttle(SHOW_EVERY, what => send({ do: 'show', ...what }));

  function connect() {
    clearTimeout(timer);
    const mine = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/ws`);
    socket = mine;
    mine.binaryType = 'arraybuffer';
    mine.onopen = () => send({ do: 'hello', token });
    heard = performance.now();
    patience = SILENCE;
    mine.onmessage = ({ data }) => {
      heard = performance.now();
      patience = SILENCE;
      if (data instanceof ArrayBuffer) {
        const frame = parseFrame(data);
        if (frame) emit('picture', frame);
        return;
      }
      const message = JSON.parse(data);
      if (message.is === 'alive') patience += PER_BYTE * message.bytes;
      if (message.is === 'answered') answered = message.number;
      if (message.is === 'welcome') {
        pause = FIRST_PAUSE;
        emit('connection', { open: true, text: 'Connected', canRetry: false });
      }
      emit(message.is, message);
    };
    mine.onclose = ({ code }) => {
      if (socket !== mine) return;
      socket = null;
      for (const waiting of [set, pixel, show]) waiting.forget();
      answered = sent;
      if (ENDINGS[code]) {
        emit('connection', { open: false, text: ENDINGS[code], canRetry: code !== 4401 });
        return;
      }
      const seconds = (pause / 1000).toFixed(1);
      emit('connection', { open: false, text: `The connection to the program is lost. Trying again in ${seconds} s.`, canRetry: true });
      timer = setTimeout(connect, pause);
      pause = Math.min(2 * pause, LONGEST_PAUSE);
    };
  }

  setInterval(() => {
    if (!socket || performance.now() - heard < patience) return;
    // The browser itself waits for an answer to the close, which will not come.
    const dead = socket;
    dead.onclose({ code: 1006 });
    dead.close();
  }, LOOK_EVERY);

  return {
    on(kind, handler) {
      handlers.set(kind, [...(handlers.get(kind) ?? []), handler]);
    },
    emit,
    connect,
    /** Changes settings, with at most ten messages per second. The last value is always sent. */
    set: changes => set.merge(changes),
    /** Whether a change is still without an answer. The newest state may not contain it. */
    isChanging: () => set.isWaiting() || (answered < sent && performance.now() - sentAt < ANSWER_WITHIN),
    /** Asks for the values of a pixel, at most ten times per second. Of questions in between, only the last one is sent. */
    pixel: (x, y) => pixel.merge({ x, y }),
    /** Says what this page wants to see. */
    show: (layer, response) => show.merge({ layer, response }),
    pause: on => send({ do: 'pause', on }),
    save: name => send({ do: 'save', name }),
    ack: frame => send({ do: 'ack', frame }),
  };
}

/** Settings that exclude each other. A new value of one of them replaces waiting values of the others. */
const EXCLUSIVE = [['gate', 'depth', 'gates'], ['fov', 'ortho']];

/** Hands values to `deliver`, at most once per `period` ms. Values that arrive in between are merged. */
function throttle(period, deliver) {
  let waiting = null;
  let timer = 0;
  let last = -Infinity;
  const flush = () => {
    timer = 0;
    if (!waiting) return;
    last = performance.now();
    deliver(waiting);
    waiting = null;
  };
  return {
    merge(values) {
      waiting ??= {};
      for (const group of EXCLUSIVE) {
        if (group.some(key => key in values)) for (const key of group) delete waiting[key];
      }
      Object.assign(waiting, values);
      const rest = last + period - performance.now();
      if (rest <= 0) flush();
      else timer ||= setTimeout(flush, rest);
    },
    isWaiting: () => waiting !== null,
    forget() {
      clearTimeout(timer);
      timer = 0;
      waiting = null;
    },
  };
}
