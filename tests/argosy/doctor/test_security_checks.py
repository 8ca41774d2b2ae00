"""The doctor's look at certificates: real keys, a real router that shows its own by mutual TLS."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from argosy.__main__ import main as argosy
from argosy.doctor import security_checks
from argosy.doctor.findings import Diagnosis
from argosy.doctor.security_checks import certificates
from commd.bus.session import session_config
from schemas.mission.model import Mission, load_mission, read_mission
from tests.support.fleet_keys import FleetKeys
from tests.support.ports import free_port
from tests.support.processes import Daemon
from tests.support.secured import Secured

MISSION = """\
mission: kept
security: {operators: [ops]}
boards: {pi1: {address: "127.0.0.1:PORT1"}, pi2: {address: "127.0.0.1:PORT2"}}
agents: {a: {program: a.asl, board: pi1}}
"""


class Kept:
    """A fleet with keys, of which pi1 is there."""

    def __init__(self, folder: Path, days: int) -> None:
        self.folder = folder
        path = folder / "kept.yaml"
        path.write_text(MISSION.replace("PORT1", str(free_port())).replace("PORT2", str(free_port())))
        (folder / "a.asl").write_text("")
        assert argosy(["keys", "init", str(path), "--dir", str(folder / "keys"), "--days", str(days)]) == 0
        self.mission: Mission = load_mission(path)

    def keys(self, name: str) -> Path:
        return self.folder / "keys" / "machines" / name

    @contextmanager
    def board(self, name: str, keys_of: str = "") -> Iterator[None]:
        """Run the router of a board."""
        where = ("--board", name, "--router", f"tcp/127.0.0.1:{free_port()}", "--state", str(self.folder / "state"))
        daemon = Daemon("commd", "serve", str(self.mission.path), *where, "--keys", str(self.keys(keys_of or name)))
        try:
            daemon.says("board=")
            yield
        finally:
            daemon.kill()

    def seen(self) -> list[Diagnosis]:
        """What the doctor says of the boards that are there, with the operator's keys."""
        return certificates(self.mission, self.keys("ops"))


def test_dates_are_seen_on_this_machine_and_from_the_boards_that_show_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = Kept(tmp_path, 400)
    with kept.board("pi1"):
        (absent,) = kept.seen()
        assert absent.level == "error"
        assert absent.text.startswith(f"pi2 presents none at {kept.mission.boards['pi2'].address}: ")
        with kept.board("pi2"):
            (fine,) = kept.seen()
            assert fine.level == "ok"
            assert fine.text.startswith("3 certificates, the first ends on 20")
            monkeypatch.setattr(security_checks, "SOON", 500 * 86_400.0)
            soon = kept.seen()
            assert [one.level for one in soon] == ["warning"] * 3
            assert [one.text.partition(" ends")[0] for one in soon] == [
                "this machine's certificate (`ops`)",
                "pi1's certificate (`pi1`)",
                "pi2's certificate (`pi2`)",
            ]
            assert ", in 399 days" in soon[1].text or ", in 400 days" in soon[1].text
            assert all("argosy keys renew" in one.do for one in soon)


def test_an_old_list_of_whom_a_machine_believes_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = Kept(tmp_path, 400)
    anchors = kept.keys("ops") / "ca.pem"
    old = anchors.read_bytes()
    for change in ("revoke", "add-board"):
        assert argosy(["keys", change, str(kept.mission.path), "pi1", "--dir", str(tmp_path / "keys")]) == 0
    with kept.board("pi1"):
        assert len(kept.seen()) == 1, "pi2 alone is not there"
        anchors.write_bytes(old)
        found = kept.seen()[0]
    assert found.text.startswith("pi1 presents one at ")
    assert "that our ca.pem does not accept" in found.text
    assert found.do.startswith("if boards were added")


def test_a_board_of_an_expired_certificate_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fleet = FleetKeys(tmp_path)
    tls, at = fleet.make("pi1", ends=-5), free_port()
    text = MISSION.replace("PORT1", str(at)).replace("PORT2", str(free_port()))
    mission = read_mission(text, tmp_path / "kept.yaml")
    listens = session_config("router", f"tls/127.0.0.1:{at}", "pi1", tls=tls)
    with zenoh.open(listens):
        said = certificates(mission, fleet.make("pi3").key.parent)
    (pi1,) = [one for one in said if "pi1" in one.text]
    assert pi1.level == "error"
    assert pi1.text.startswith("pi1's certificate (`pi1`) expired on 20")


def test_keys_that_are_missing_or_open_to_others_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kept = Kept(tmp_path, 400)
    assert certificates(kept.mission, None) == [], "a fleet without keys has no certificates"
    (missing,) = certificates(kept.mission, tmp_path / "nowhere")
    assert missing.level == "error"
    (kept.keys("ops") / "key.pem").chmod(0o644)
    (found,) = kept.seen()
    assert "others on this machine may read the key" in found.text


def test_a_certificate_that_has_ended_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = Kept(tmp_path, 30)
    later = time.time() + 31 * 86_400
    monkeypatch.setattr(time, "time", lambda: later)
    (found,) = kept.seen()
    assert found.level == "error"
    assert "expired" in found.text


def test_an_operator_with_keys_looks_a_secured_fleet_over(capsys: pytest.CaptureFixture[str]) -> None:
    with Secured() as fleet:
        fleet.routers(["pi1", "pi2"])
        fleet.start("pi1", "agentd").says("agents=a")
        capsys.readouterr()
        assert argosy(["doctor", str(fleet.path), "--keys", str(fleet.keys("ops")), "--json"]) == 1
        told = json.loads(capsys.readouterr().out)["findings"]
        assert argosy(["status", str(fleet.path), "--keys", str(fleet.keys("eye")), "--wait", "5"]) == 1
        seen = capsys.readouterr().out.splitlines()
    levels = {(one["what"], one["level"]) for one in told}
    assert {("versions", "ok"), ("clocks", "ok"), ("disks", "ok"), ("access", "ok")} <= levels, told
    errors = [one["text"] for one in told if one["level"] == "error"]
    assert any(text.startswith("pi3 presents none at ") for text in errors)
    assert "all daemons of pi3 are missing: commd pi3, bridged r3, agentd c" in errors
    assert {"up commd pi1", "up commd pi2", "up agentd a", "missing commd pi3"} <= {
        " ".join(line.split()[:3]) for line in seen
    }
