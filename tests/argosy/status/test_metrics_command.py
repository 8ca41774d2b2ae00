"""`argosy metrics`: what Prometheus reads, over real HTTP."""

import asyncio
import re
import urllib.request
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from argosy.__main__ import main
from argosy.cli.port_check import is_loopback
from argosy.fleet_model.fleet_status import Row
from argosy.status import metrics_command
from argosy.status.metrics_command import CALLERS, COUNTERS, REQUEST_BYTES, Fleet, Page
from schemas.wire.records import Health, Note
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.processes import Daemon, running

UGLY = 'a "quoted"\nline \\ back'


def samples(page: str) -> dict[tuple[str, tuple[str, ...]], float]:
    """Return what Prometheus makes of a page: each sample by its name and the values of its labels, in this order."""
    order = ("fleet", "board", "daemon", "name", "version", "counter")
    return {
        (sample.name, tuple(sample.labels[name] for name in order if name in sample.labels)): sample.value
        for family in text_string_to_metric_families(page)
        for sample in family.samples
    }


def test_prometheus_reads_every_figure_and_every_label_as_it_was_told() -> None:
    health = Health(
        version=UGLY, uptime=7.5, lag=0.25, drops=3, restarts=2, errors=1, notes=(Note("x", "x"),), counters={"m": 4.0}
    )
    rows = [
        Row("uav", "bridged", "pi1", "up", health, 0.4),
        Row("a", "agentd", "pi1", "missing"),
        Row("old", "agentd", "pi1", "up", Health(), 0.1),
    ]
    found = samples(Fleet("sar", rows, True).page().decode())
    uav = ("sar", "pi1", "bridged", "uav")
    assert found["argosy_router_up", ("sar",)] == 1
    assert found["argosy_up", uav] == 1
    assert found["argosy_up", ("sar", "pi1", "agentd", "a")] == 0
    assert found["argosy_info", (*uav, UGLY)] == 1
    assert found["argosy_counter", (*uav, "m")] == 4
    figures = {
        "uptime_seconds": 7.5,
        "lag_seconds": 0.25,
        "drops_total": 3,
        "restarts": 2,
        "errors_total": 1,
        "notes": 1,
    }
    assert {name: found[f"argosy_{name}", uav] for name in figures} == figures
    assert ("argosy_restarts", ("sar", "pi1", "agentd", "old")) not in found, "what is not known is no nought"
    page = Fleet("s", rows, True).page().decode()
    kinds = {family.name: family.type for family in text_string_to_metric_families(page)}
    assert kinds["argosy_drops"] == "counter"
    assert kinds["argosy_lag_seconds"] == "gauge"


def test_counters_without_end_are_cut() -> None:
    health = Health(counters={f"c{number}": 1.0 for number in range(COUNTERS + 50)})
    page = Fleet("sar", [Row("a", "agentd", "pi1", "up", health, 0.1)], False).page().decode()
    assert page.count("\nargosy_counter{") == COUNTERS
    assert samples(page)["argosy_router_up", ("sar",)] == 0


async def ask(port: int, request: bytes) -> bytes:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(request)
    answer = await reader.read()
    writer.close()
    return answer


@pytest.mark.parametrize(
    ("request_", "first"),
    [
        (b"GET /metrics HTTP/1.1\r\n\r\n", b"HTTP/1.1 200 OK"),
        (b"GET /metrics?x=1 HTTP/1.0\r\nHost: localhost:9464\r\n\r\n", b"HTTP/1.1 200 OK"),
        (b"GET /metrics HTTP/1.1\r\nA: b\r\nhost:[::1]:9464\r\n\r\n", b"HTTP/1.1 200 OK"),
        (b"GET /metrics HTTP/1.1\r\nHost: evil.example:9464\r\n\r\n", b"HTTP/1.1 421 "),
        (b"GET /metrics HTTP/1.1\r\nHost: \xff\r\n\r\n", b"HTTP/1.1 421 "),
        (b"HEAD /metrics HTTP/1.1\r\n\r\n", b"HTTP/1.1 200 OK"),
        (b"GET /etc/passwd HTTP/1.1\r\n\r\n", b"HTTP/1.1 404 Not Found"),
        (b"POST /metrics HTTP/1.1\r\n\r\n", b"HTTP/1.1 405 Method Not Allowed"),
        (b"\x00\x01\r\n\r\n", b"HTTP/1.1 405 Method Not Allowed"),
        (b"GET /" + b"x" * 2 * REQUEST_BYTES + b" HTTP/1.1\r\n\r\n", b""),
    ],
)
async def test_only_get_metrics_has_an_answer_and_what_is_too_long_none(request_: bytes, first: bytes) -> None:
    port = free_port()
    server = await asyncio.start_server(Page(lambda: b"page\n").answer, "127.0.0.1", port, limit=REQUEST_BYTES)
    async with server:
        try:
            answer = await asyncio.wait_for(ask(port, request_), 120)
        except ConnectionError:
            answer = b""
        assert answer.startswith(first)
        if first.endswith(b"OK"):
            assert answer.endswith(b"page\n") is request_.startswith(b"GET")


async def test_callers_that_say_nothing_are_bounded_and_give_their_place_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(metrics_command, "REQUEST_PATIENCE", 120.0)
    port = free_port()
    page = Page(lambda: b"page\n")
    server = await asyncio.start_server(page.answer, "127.0.0.1", port, limit=REQUEST_BYTES)
    async with server, asyncio.timeout(240):
        mute = [await asyncio.open_connection("127.0.0.1", port) for _ in range(CALLERS)]
        await until(lambda: page.callers >= CALLERS, "all are let in")
        with suppress(ConnectionError):
            assert await ask(port, b"GET /metrics HTTP/1.1\r\n\r\n") == b""
        for _, writer in mute:
            writer.close()
        await until(lambda: not page.callers, "all have left")
        assert (await ask(port, b"GET /metrics HTTP/1.1\r\n\r\n")).endswith(b"page\n")


def test_a_real_fleet_is_read_over_http(tmp_path: Path, endpoint: str) -> None:
    mission = tmp_path / "trial.yaml"
    mission.write_text("mission: trial\nagents: {a: {program: a.asl}}\n")
    (tmp_path / "a.asl").write_text("!start.\n+!start <- .print(ready).\n")
    where = f"127.0.0.1:{free_port()}"
    with (
        running("commd", "serve", str(mission), "--router", endpoint, "--state", str(tmp_path)),
        running("argosy", "metrics", str(mission), "--router", endpoint, "--listen", where) as exporter,
    ):
        exporter.says(f"serving http://{where}/metrics")
        up = ("argosy_up", ("trial", "local", "commd", "local"))
        read(where, exporter, lambda found: found.get(up) == 1)
        found = read(where, exporter, lambda found: True)
        assert found["argosy_up", ("trial", "local", "agentd", "a")] == 0
        assert found["argosy_restarts", up[1]] == 0
        again = Daemon("argosy", "metrics", str(mission), "--router", endpoint, "--listen", where)
        assert again.ends() == 1
        assert f"error: cannot listen at {where}: " in again.text


def read(where: str, daemon: Daemon, wanted: Any) -> dict[Any, float]:
    """Read the page until it is as wanted."""
    found: dict[Any, float] = {}

    def looked(_: str) -> bool:
        nonlocal found
        with urllib.request.urlopen(f"http://{where}/metrics", timeout=90) as answer:
            assert re.match(r"text/plain; version=0\.0\.4", answer.headers["Content-Type"])
            found = samples(answer.read().decode())
        return bool(wanted(found))

    daemon.until(looked, "the page is as wanted")
    return found


def test_an_address_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["metrics", "--listen", "nowhere"])
    assert ended.value.code == 2
    assert "--listen" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("host", "loopback"),
    [
        ("127.0.0.1", True),
        ("127.8.0.1", True),
        ("[::1]", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("pi1", False),
    ],
)
def test_it_is_known_what_other_machines_cannot_reach(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback
