#!/usr/bin/env python3
"""How often does `taugate view` show a new picture while the camera or the gate moves?

    python3 benches/viewer.py target/release/taugate --resolution 640x360

Needs nothing but Python. Moves the Cornell box's camera, then its gate, every 30 ms, as a page does, and takes each picture at once.
Prints the time between pictures, and their sizes.
"""

import argparse
import base64
import collections
import json
import math
import os
import pathlib
import select
import socket
import statistics
import struct
import subprocess
import tempfile
import time

SCENE = pathlib.Path(__file__).parent.parent / "scenes" / "cornell-box.glb"
# Time between two changes in seconds, as in link.js.
PERIOD = 0.03


class Page:
    """A connection as a page has it."""

    def __init__(self, url):
        address, token = url.split("/#")
        host, port = address.removeprefix("http://").split(":")
        self.socket = socket.create_connection((host, int(port)))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = ["GET /ws HTTP/1.1", f"Host: {host}:{port}", f"Origin: {address}", "Upgrade: websocket"]
        lines += ["Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", "", ""]
        self.socket.sendall("\r\n".join(lines).encode())
        self.bytes = b""
        while b"\r\n\r\n" not in self.bytes:
            self.bytes += self.socket.recv(4096)
        self.bytes = self.bytes.split(b"\r\n\r\n", 1)[1]
        self.send({"do": "hello", "token": token})

    def send(self, message):
        data = json.dumps(message).encode()
        length = struct.pack("!BB", 0x81, 0x80 | len(data)) if len(data) < 126 else struct.pack("!BBH", 0x81, 0xFE, len(data))
        # The mask is 0.
        self.socket.sendall(length + bytes(4) + data)

    def take(self, count):
        while len(self.bytes) < count:
            more = self.socket.recv(1 << 20)
            if not more:
                raise SystemExit("the program closed the connection")
            self.bytes += more
        taken, self.bytes = self.bytes[:count], self.bytes[count:]
        return taken

    def message(self, until):
        """The next message, a picture (bytes) or text; `None` if none comes until then."""
        if not self.bytes and not select.select([self.socket], [], [], max(0.0, until - time.monotonic()))[0]:
            return None
        first, length = self.take(2)
        length &= 0x7F
        if length > 125:
            [length] = struct.unpack("!H" if length == 126 else "!Q", self.take(2 if length == 126 else 8))
        data = self.take(length)
        return {1: bytes.decode, 2: bytes}.get(first & 0xF, lambda data: "")(data)


def watch(page, seconds, change):
    """Sends `change(n)` every PERIOD. Returns the times of the pictures of changed settings, and their sizes."""
    times, sizes, number, begin = [], collections.Counter(), 0, time.monotonic()
    due = begin
    while time.monotonic() < begin + seconds:
        if time.monotonic() >= due:
            number, due = number + 1, max(due + PERIOD, time.monotonic())
            page.send({"do": "set", "changes": change(number), "number": number})
        message = page.message(due)
        if isinstance(message, bytes):
            frame, revision, width, height = struct.unpack("<4I", message[4:20])
            page.send({"do": "ack", "frame": frame})
            if not times or revision != times[-1][1]:
                times.append((time.monotonic(), revision))
                sizes[f"{width}x{height}"] += 1
    return times, sizes


def describe(name, times, sizes):
    gaps = sorted(1000 * (b - a) for (a, _), (b, _) in zip(times, times[1:]))
    if len(gaps) < 10:
        return f"{name}: only {len(gaps)} gaps between pictures"
    late = gaps[int(0.95 * len(gaps))]
    shown = ", ".join(f"{count} of {size}" for size, count in sizes.most_common())
    return f"{name}: a picture every {statistics.median(gaps):.0f} ms (95 % within {late:.0f} ms); {shown}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--resolution", default="640x360")
    parser.add_argument("--estimator", default="lcs")
    parser.add_argument("--seconds", type=float, default=10.0, help="time for each of camera and gate")
    given = parser.parse_args()
    flags = ["--gate", "6.2m..6.5m", "--estimator", given.estimator, "--resolution", given.resolution]
    with tempfile.TemporaryDirectory() as folder:
        words = [given.program, "view", SCENE, *flags, "--listen", "127.0.0.1:0", "--save-to", folder]
        with subprocess.Popen(list(map(str, words)), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as program:
            try:
                page = Page(program.stdout.readline().rstrip())
                # Until the scene is prepared and the kernels are compiled.
                end = time.monotonic() + 8.0
                while time.monotonic() < end:
                    message = page.message(end)
                    if isinstance(message, bytes):
                        page.send({"do": "ack", "frame": struct.unpack("<I", message[4:8])[0]})

                def camera(n):
                    return {"look-from": f"{0.3 * math.sin(0.02 * n):.4f},1,{3.4 + 0.1 * math.cos(0.02 * n):.4f}", "look-at": "0,1,0"}

                def gate(n):
                    begin = 6.2 + 0.4 * math.sin(0.02 * n)
                    return {"gate": f"{begin:.4f}m..{begin + 0.3:.4f}m"}

                for name, change in [("camera", camera), ("gate", gate)]:
                    print(describe(name, *watch(page, given.seconds, change)), flush=True)
                    time.sleep(1.0)
            finally:
                program.kill()


main()
