"""What a board tells of machines that it refuses."""

import argparse
import asyncio
import subprocess
import sys

import pytest

import commd.daemon
from argosy.__main__ import main as argosy
from argosy.deploy import board_command
from commd.bus.bus import open_bus
from commd.bus.tls import files_in
from commd.router.tls_rejections import reason_of
from schemas.wire import keys
from schemas.wire.records import Health
from tests.support.buses import until
from tests.support.processes import ROOT
from tests.support.secured import Secured


def test_a_refused_machine_is_seen_in_the_log_and_the_health_of_the_board(capsys: pytest.CaptureFixture[str]) -> None:
    with Secured() as fleet:
        foreign = fleet.folder / "foreign"
        argosy(["keys", "init", str(fleet.path), "--dir", str(foreign)])
        commd = fleet.start("pi1", "commd")
        commd.says("router board=")
        tls = files_in(foreign / "machines" / "pi3")
        (tls.root).write_bytes(fleet.tls("pi3").root.read_bytes())  # so that it goes there at all
        command = [sys.executable, "-c", _DIAL, str(fleet.ports["pi1"]), str(tls.certificate), str(tls.key)]
        commd.until(
            lambda text: (
                "refused a machine that dials this board: its certificate is of another authority" in text
                or bool(subprocess.run(command, timeout=60).returncode)
            ),
            "the refusal is told",
        )

        async def counted() -> None:
            options = {"fleet": "three", "name": "x", "daemon": "agentd"}
            async with open_bus(fleet.socket("pi1"), **options) as bus:  # type: ignore[arg-type]
                told: list[float] = []
                key = keys.health("three", "pi1", "commd")
                bus.subscribe(key, Health, lambda _, said: told.append(said.counters.get("refused", 0)))
                await until(lambda: bool(told) and told[-1] > 0, "health counts it")

        asyncio.run(counted())


_DIAL = """
import socket, ssl, sys
context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
context.load_cert_chain(sys.argv[2], sys.argv[3])
try:
    with context.wrap_socket(socket.create_connection(("127.0.0.1", int(sys.argv[1])), 5)) as session:
        session.settimeout(1)
        session.recv(1)
except OSError:
    pass
"""


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("peer sent no certificates", "it showed no certificate"),
        ("invalid peer certificate: UnknownIssuer", "its certificate is of another authority, or was revoked"),
        ("received corrupt message of type InvalidContentType", "it speaks no TLS"),
        ("something that nobody knew", "something that nobody knew"),
    ],
)
def test_what_zenoh_says_of_handshakes_is_told_in_words(said: str, words: str) -> None:
    assert reason_of(said) == words


_SPEAKER = """
import os, sys, time
from commd.router import tls_rejections as refusals
from commd.process.output import flush, stdout
refusals.hear_refusals()
for number in range(3 * refusals.REASONS):
    os.write(1, b"WARN zenoh_link_tls::unicast: what nobody knew %d. Hint: x\\n" % number)
os.write(1, b"WARN zenoh_link_tls::unicast: certificate expired. Hint: x\\n")
stdout().write("[a] by a program")
print("by its Python function")
until = time.monotonic() + 30
while refusals.counters["refused"] <= 3 * refusals.REASONS and time.monotonic() < until:
    time.sleep(0.01)
flush()
"""


def test_what_agents_print_goes_where_it_went_although_zenohs_words_are_heard() -> None:
    said = subprocess.run([sys.executable, "-c", _SPEAKER], capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert sorted(said.stdout.splitlines()) == ["[a] by a program", "by its Python function"]
    assert said.stderr.count("refused a machine") == 102, "words without end are one reason"
    assert "its certificate has expired count=1" in said.stderr


@pytest.mark.parametrize(("options", "hears"), [((), False), (("--keys", "k"), True), (("--config", "c"), True)])
def test_a_board_in_one_process_hears_refusals_where_commd_does(
    options: tuple[str, ...], hears: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[bool] = []
    for module in (board_command, commd.daemon):
        monkeypatch.setattr(module, "hear_refusals", lambda: heard.append(True))
        monkeypatch.setattr(module, "run_daemon", lambda *_: 0)
        parser = argparse.ArgumentParser()
        module.add_arguments(parser)
        assert module.run(parser.parse_args(["mission.yaml", *options])) == 0
    assert heard == [True, True] * hears
