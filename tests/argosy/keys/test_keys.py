"""`argosy keys`: who gets which certificate, what lies where, and what is said of mistakes."""

import json
import os
import shutil
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from argosy.__main__ import main as argosy
from argosy.cli.extras import install_command
from commd.bus.tls import files_in, identity_of
from schemas.files.findings import Findings

MISSION = """\
mission: rescue
fleet: sar
boards:
  pi1: {address: 10.0.0.11}
  pi2: {address: "pi2.field:7500"}
  pi3: {address: "[fd00::3]:7447"}
agents:
  a: {program: a.asl, board: pi1}
security: {operators: [alice], observers: [bob]}
"""
EVERYBODY = ("pi1", "pi2", "pi3", "alice", "bob")


class Desk:
    """An operator with a mission and a folder of keys."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.mission, self.keys, self._capsys = folder / "rescue.yaml", folder / "sar", capsys
        self.mission.write_text(MISSION)
        self.out = self.err = ""

    def __call__(self, command: str, *rest: str) -> int:
        """Run `argosy keys COMMAND MISSION ...`."""
        code = argosy(["keys", command, str(self.mission), *rest, "--dir", str(self.keys)])
        self.out, self.err = self._capsys.readouterr()
        return code

    def folder(self, name: str) -> Path:
        return self.keys / "machines" / name

    def file(self, name: str, file: str) -> bytes:
        return (self.folder(name) / file).read_bytes()

    def edit(self, old: str, new: str) -> None:
        assert old in self.mission.read_text()
        self.mission.write_text(self.mission.read_text().replace(old, new))


@pytest.fixture
def desk(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Desk:
    return Desk(tmp_path, capsys)


@pytest.fixture
def made(desk: Desk) -> Desk:
    assert desk("init") == 0
    return desk


def test_everybody_in_the_mission_gets_a_certificate_for_where_others_dial(made: Desk) -> None:
    found = {name: identity_of(files_in(made.folder(name)), time.time()) for name in EVERYBODY}
    assert {name: identity.name for name, identity in found.items()} == {name: name for name in EVERYBODY}
    assert found["pi1"].addresses == ("10.0.0.11", "pi1", "pi1.local")
    assert found["pi2"].addresses == ("pi2.field", "pi2", "pi2.local")
    assert found["pi3"].is_at("fd00::3")
    assert found["alice"].addresses == (), "nobody dials people"
    assert all(390 < (identity.ends - time.time()) / 86_400 < 400.1 for identity in found.values())


def test_secrets_are_for_their_owner_alone_whatever_the_umask(desk: Desk) -> None:
    before = os.umask(0)
    try:
        assert desk("init") == 0
    finally:
        os.umask(before)
    for path in (desk.keys, *desk.keys.rglob("*")):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path
    assert sorted(path.name for path in desk.folder("pi1").iterdir()) == ["ca.pem", "cert.pem", "key.pem"]
    secrets = [path for path in desk.keys.rglob("*") if path.is_file() and b"PRIVATE KEY" in path.read_bytes()]
    assert {path.name for path in secrets} == {"ca.key", "key.pem"}
    assert len(secrets) == 1 + len(EVERYBODY)


def test_keys_that_are_there_are_never_overwritten(made: Desk) -> None:
    before = {path: path.read_bytes() for path in made.keys.rglob("*") if path.is_file()}
    assert made("init") == 2
    assert "a fleet's keys are here already" in made.err
    assert made("add-board", "pi1") == 2
    assert "`pi1` already has a certificate" in made.err
    assert {path: path.read_bytes() for path in made.keys.rglob("*") if path.is_file()} == before


def test_the_folder_of_all_keys_is_told_from_that_of_a_machine(made: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    assert argosy(["keys", "show", str(made.keys)]) == 2
    said = capsys.readouterr().err
    assert "the folder of all keys of a fleet" in said
    assert str(made.folder("pi1")) in said


def test_a_board_that_came_to_the_mission_is_added_and_all_boards_are_to_know_it(made: Desk) -> None:
    certificates = {name: made.file(name, "cert.pem") for name in EVERYBODY}
    made.edit("  pi3:", "  pi4: {address: 10.0.0.14}\n  pi3:")
    assert made("show") == 1
    assert f"pi4    board     has no certificate: `argosy keys add-board {made.mission} pi4`" in made.out
    assert made("add-board", "pi4", "--address", "192.168.4.4") == 0
    assert {name: made.file(name, "cert.pem") for name in EVERYBODY} == certificates
    assert identity_of(files_in(made.folder("pi4")), time.time()).is_at("192.168.4.4")
    assert made.file("pi1", "ca.pem") == made.file("pi4", "ca.pem")
    assert made.out.splitlines()[1:] == [
        "copy these files to the boards and restart commd, so that they accept pi4:",
        *(f"  {board}: {made.folder(board)}/ca.pem" for board in ("pi1", "pi2", "pi3")),
        "copy these files to operators and observers, who then accept pi4:",
        *(f"  {one}: {made.folder(one)}/ca.pem" for one in ("alice", "bob")),
        "each of these boards also needs a new router.json5 with the rights of pi4: argosy units",
    ]
    assert made("show") == 0


def test_new_keys_for_one_machine_change_nothing_for_the_others(made: Desk) -> None:
    made.edit("10.0.0.11", "10.0.0.21")
    assert made("show") == 1
    assert "its address in the mission is 10.0.0.21: replace the certificate with `argosy keys renew`" in made.out
    before = {path: path.read_bytes() for path in made.keys.rglob("*.pem")}
    assert made("renew", "pi1") == 0
    assert "restart its commd; other machines need nothing" in made.out
    changed = {path for path, content in before.items() if path.read_bytes() != content}
    assert changed == {made.folder("pi1") / "cert.pem", made.folder("pi1") / "key.pem"}
    assert identity_of(files_in(made.folder("pi1")), time.time()).is_at("10.0.0.21")


def test_certificates_that_end_soon_are_renewed_without_being_named(desk: Desk) -> None:
    assert desk("init", "--days", "20") == 0
    assert desk("show") == 1
    assert desk.out.count("ends soon: replace it with `argosy keys renew`") == len(EVERYBODY)
    assert desk("renew") == 0
    assert desk.out.count("restart its commd") == len(EVERYBODY)


def test_who_is_revoked_is_believed_by_nobody_and_a_successor_is(made: Desk, tmp_path: Path) -> None:
    stolen = made.folder("pi3").rename(tmp_path / "stolen")
    assert made("revoke", "pi3") == 0
    assert not made.folder("pi3").exists()
    for name in ("pi1", "pi2", "alice", "bob"):
        assert f"  {name}: {made.folder(name)}/ca.pem" in made.out
        (stolen / "ca.pem").write_bytes(made.file(name, "ca.pem"))
        with pytest.raises(Findings, match="of different fleets, or it was revoked"):
            identity_of(files_in(stolen), time.time())
    assert made("show") == 1
    assert "add it again" in made.out
    assert made("renew", "pi3") == 2
    assert "there is no machine with a certificate `pi3`" in made.err
    assert made("add-board", "pi3") == 0
    assert "board (number 2 of this name)" in made.out
    assert identity_of(files_in(made.folder("pi3")), time.time()).name == "pi3"
    (stolen / "ca.pem").write_bytes(made.file("pi1", "ca.pem"))
    with pytest.raises(Findings, match="of different fleets, or it was revoked"):
        identity_of(files_in(stolen), time.time())


def test_a_revocation_that_was_interrupted_is_told_and_finished(made: Desk, tmp_path: Path) -> None:
    stolen = shutil.copytree(made.folder("pi3"), tmp_path / "stolen")
    before = {name: made.file(name, "ca.pem") for name in ("pi1", "pi2", "alice")}
    assert made("revoke", "pi3") == 0
    for name in ("pi2", "alice"):  # as if it had been killed before these were written
        (made.folder(name) / "ca.pem").write_bytes(before[name])
    assert made("show") == 1
    assert "ca.pem of pi2, alice is not up to date: a command was interrupted" in made.out
    assert made("revoke", "pi3") == 0
    assert made.out.startswith("completed an interrupted command; copy these files to their machines:\n  pi2: ")
    (stolen / "ca.pem").write_bytes(made.file("pi2", "ca.pem"))
    with pytest.raises(Findings, match="or it was revoked"):
        identity_of(files_in(stolen), time.time())
    made("show")
    assert "interrupted" not in made.out
    assert made("revoke", "pi3") == 0, "again is no mistake"


def test_the_first_keys_are_made_again_after_an_interruption(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "argosy.keys.certificate_authority.Authority.secret", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)
    )
    assert desk("init") != 0
    assert (desk.keys / "fleet.json").exists()
    monkeypatch.undo()
    assert desk("init") == 0
    assert desk("show") == 0


def test_a_key_without_its_certificate_is_told_and_renewed(made: Desk) -> None:
    (made.folder("pi1") / "key.pem").write_bytes(made.file("pi2", "key.pem"))
    assert made("show") == 1
    assert "key.pem does not match cert.pem: replace both with `argosy keys renew`" in made.out
    assert made("renew", "pi1") == 0
    assert made("show") == 0


def test_first_keys_are_made_by_one_command_at_a_time(desk: Desk) -> None:
    from argosy.keys.key_store import alone

    with alone(desk.keys):
        assert desk("init") == 2
        assert not (desk.keys / "ca.key").exists()
    assert "another `argosy keys` is using this folder" in desk.err


def test_people_are_believed_by_boards_and_not_by_one_another(made: Desk, tmp_path: Path) -> None:
    alice = made.folder("alice").rename(tmp_path / "alice")
    identity_of(files_in(alice), time.time())
    (alice / "ca.pem").write_bytes(made.file("pi1", "ca.pem"))
    identity_of(files_in(alice), time.time())
    (alice / "ca.pem").write_bytes(made.file("bob", "ca.pem"))
    with pytest.raises(Findings, match="of different fleets"):
        identity_of(files_in(alice), time.time())


def test_a_machine_shows_what_its_own_folder_says(made: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    assert argosy(["keys", "show", str(made.folder("pi1"))]) == 0
    said = capsys.readouterr().out
    assert said.startswith("pi1: until 20")
    assert "UTC, for 10.0.0.11, pi1, pi1.local\naccepts: alice, bob, pi1, pi2, pi3\n" in said


def test_a_password_locks_the_fleets_secret(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARGOSY_KEYS_PASSWORD", "open sesame")
    assert desk("init", "--password") == 0
    assert b"ENCRYPTED" in (desk.keys / "ca.key").read_bytes()
    assert desk("renew", "pi1") == 0
    monkeypatch.setenv("ARGOSY_KEYS_PASSWORD", "open barley")
    assert desk("renew", "pi1") == 2
    assert "ca.key: error: the fleet's secret cannot be used: wrong password, or an invalid file" in desk.err
    monkeypatch.delenv("ARGOSY_KEYS_PASSWORD")
    assert desk("renew", "pi1") == 2
    assert "there is no terminal to ask for the password: set ARGOSY_KEYS_PASSWORD" in desk.err


MISTAKES: dict[str, tuple[Callable[[Desk], object], tuple[str, ...], str]] = {
    "unknown board": (lambda _: None, ("add-board", "pi4"), "there is no board `pi4`, did you mean `pi"),
    "a person as a board": (lambda _: None, ("add-board", "alice"), "there is no board `alice`"),
    "another fleet": (
        lambda desk: desk.edit("fleet: sar", "fleet: other"),
        ("renew", "pi1"),
        "the keys here belong to fleet `sar`, the mission has fleet `other`",
    ),
    "a record that was lost": (
        lambda desk: (desk.keys / "fleet.json").unlink(),
        ("show",),
        "fleet.json: error: is missing, but ca.key exists: restore it from your backup",
    ),
    "no keys yet": (
        lambda desk: shutil.rmtree(desk.keys),
        ("show",),
        "no keys of fleet `sar` are here: create them with `argosy keys init`, or name their folder by --dir",
    ),
    "a record of something else": (
        lambda desk: (desk.keys / "fleet.json").write_text('{"fleet": 1}'),
        ("show",),
        "fleet.json: error: was not written by `argosy keys`",
    ),
    "a secret for all": (
        lambda desk: (desk.keys / "ca.key").chmod(0o644),
        ("renew", "pi1"),
        "ca.key: error: other users of this machine can read the fleet's secret: run `chmod 600",
    ),
    "no secret": (
        lambda desk: (desk.keys / "ca.key").unlink(),
        ("revoke", "pi1"),
        "it is needed to create certificates",
    ),
    "a broken secret": (
        lambda desk: (desk.keys / "ca.key").write_text("x"),
        ("renew", "pi1"),
        "the fleet's secret cannot be used",
    ),
    "no such host": (lambda _: None, ("renew", "pi1", "--address", "a b"), "expected a host name or an IP address"),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_each_mistake_is_told_in_words(made: Desk, what: str) -> None:
    spoil, command, words = MISTAKES[what]
    spoil(made)
    assert made(*command) == 2
    assert words in made.err
    assert "Traceback" not in made.err


def test_a_mission_of_one_machine_needs_no_keys(desk: Desk) -> None:
    desk.mission.write_text("mission: one\nagents: {a: {program: a.asl}}\n")
    assert desk("init") == 2
    assert "the mission declares no `boards`" in desk.err
    assert not desk.keys.exists()


def test_two_commands_do_not_change_the_keys_at_once(made: Desk) -> None:
    from argosy.keys.key_store import alone

    with alone(made.keys):
        assert made("renew", "pi1") == 2
    assert "another `argosy keys` is using this folder" in made.err


def test_keys_lie_in_the_users_folder_or_another(desk: Desk, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert argosy(["keys", "init", str(desk.mission)]) == 0
    record = json.loads((tmp_path / "data" / "argosy" / "keys" / "sar" / "fleet.json").read_text())
    assert sorted(record["members"]) == sorted(EVERYBODY)


def test_the_extra_that_is_missing_is_named(desk: Desk) -> None:
    code = "import sys; sys.modules['cryptography'] = None\nfrom argosy.__main__ import main\nsys.exit(main())"
    command = [sys.executable, "-c", code, "keys", "init", str(desk.mission), "--dir", str(desk.keys)]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (said.returncode, said.stderr) == (2, f"error: argosy needs cryptography: {install_command('keys')}\n")
