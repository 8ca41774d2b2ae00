"""What is no HTTP is refused and counted; it is no defect of the server."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

import pytest

from tests.support.processes import running

MALFORMED = (
    b"\x00\x01\x02\r\n\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nA\x1b[2J: \r\n\r\n",
    b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\nHost: x\r\n\r\n",
    b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n",
    b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"GET http://[::1 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil\r\n\r\n",
    b"GET /?token=%ff%00%zz HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: \xff=\xff\r\n\r\n",
)


@pytest.mark.timeout(90)
def test_a_malformed_request_is_refused_and_counted(endpoint: str) -> None:
    with running("argosy", "ui", "--router", endpoint, "--port", "0") as ui:
        ui.says("open http://")
        at = urlsplit(next(line for line in ui.text.splitlines() if line.startswith("open "))[5:])
        assert at.hostname
        assert at.port
        for sent in MALFORMED:
            with socket.create_connection((at.hostname, at.port), timeout=10) as link:
                link.sendall(sent)
                link.shutdown(socket.SHUT_WR)
                got = link.recv(65_536)
                assert not got or (got.startswith(b"HTTP/1.") and got[9:10] == b"4"), (sent, got)
                assert b"Traceback" not in got
        ui.says("malformed requests so far")
        assert "defect" not in ui.text
        assert "Traceback" not in ui.text
        assert "\x1b" not in ui.text
