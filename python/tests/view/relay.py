"""Forwards connections to another port, as `ssh -L` does. It can cut them, and delay what the program sends."""

import contextlib
import queue
import socket
import threading
import time

HERE = "127.0.0.1"


class Relay:
    def __init__(self, target, delay=0.0):
        """Everything from the port `target` arrives later by `delay` seconds."""
        self._target, self._delay = target, delay
        self._open = []
        self._is_cut = False
        self._listener = socket.create_server((HERE, 0))
        self.port = self._listener.getsockname()[1]
        # The thread ends with the process.
        start(self._accept)

    def cut(self):
        """Ends all connections and refuses new ones."""
        self._is_cut = True
        while self._open:
            shut(self._open.pop())

    def mend(self):
        self._is_cut = False

    def _accept(self):
        while True:
            client, _ = self._listener.accept()
            try:
                if self._is_cut:
                    raise ConnectionRefusedError
                server = socket.create_connection((HERE, self._target))
            except OSError:
                client.close()
                continue
            for source, sink, delay in ((client, server, 0.0), (server, client, self._delay)):
                self._open.append(source)
                parts = queue.SimpleQueue()
                start(receive, source, parts)
                start(deliver, sink, parts, delay)


def start(work, *arguments):
    threading.Thread(target=work, args=arguments, daemon=True).start()


def shut(stream):
    # The other side may have closed it.
    with contextlib.suppress(OSError):
        stream.shutdown(socket.SHUT_RDWR)


def receive(source, parts):
    with contextlib.suppress(OSError):
        while part := source.recv(1 << 16):
            parts.put((time.monotonic(), part))
    parts.put(None)


def deliver(sink, parts, delay):
    with contextlib.suppress(OSError):
        while item := parts.get():
            arrival, part = item
            time.sleep(max(0.0, arrival + delay - time.monotonic()))
            sink.sendall(part)
    shut(sink)
