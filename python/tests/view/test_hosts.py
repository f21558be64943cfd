"""Requests that the viewer refuses. These tests need no browser."""

import socket

from .program import PATIENCE, view


def status(port, *lines):
    """The beginning of the answer to a request of these lines: the version of HTTP, and the code."""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as stream:
        stream.sendall("".join(f"{line}\r\n" for line in (*lines, "")).encode())
        return stream.makefile("rb").read(12).decode()


def test_foreign_hosts_and_origins_are_refused():
    with view("--spp", "2") as viewer:
        port = viewer.port
        assert status(port, "GET / HTTP/1.1", f"Host: localhost:{port}", "Connection: close") == "HTTP/1.1 200"
        assert status(port, "GET / HTTP/1.1", f"Host: evil.example:{port}", "Connection: close") == "HTTP/1.1 403"
        socket_request = (
            "GET /ws HTTP/1.1",
            f"Host: localhost:{port}",
            "Connection: Upgrade",
            "Upgrade: websocket",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        )
        assert status(port, *socket_request, f"Origin: http://localhost:{port}") == "HTTP/1.1 101"
        assert status(port, *socket_request, "Origin: http://evil.example") == "HTTP/1.1 403"
        assert status(port, *socket_request) == "HTTP/1.1 403"
