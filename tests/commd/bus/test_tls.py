"""A machine's folder of keys, read by what the standard library has: who one is, and what is wrong in words."""

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from commd.bus.tls import Tls, check_board, identity_of, tls_in
from schemas.files.findings import Findings
from schemas.mission.model import read_mission
from tests.support.fleet_keys import FleetKeys

MISSION = 'mission: m\nboards: {pi1: {address: "ADDRESS"}, pi2: {}}\nagents: {a: {program: a.asl, board: pi1}}\n'


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> FleetKeys:
    return FleetKeys(tmp_path_factory.mktemp("keys"))


def test_keys_tell_who_one_is_where_and_until_when(fleet: FleetKeys) -> None:
    tls = fleet.make("pi1", hosts=("10.0.0.11", "pi1.local", "fd00::1"), ends=86_400)
    identity = identity_of(tls_in(tls.key.parent), time.time())
    assert identity.name == "pi1"
    assert 86_300 < identity.ends - time.time() < 86_460
    assert identity.begins < time.time() - 600 * 86_400, "a board without a clock of its own starts in the past"
    assert all(map(identity.is_at, ("10.0.0.11", "PI1.local", "fd00:0:0::1")))
    assert not identity.is_at("10.0.0.12")


def _locked(fleet: FleetKeys, tls: Tls) -> None:
    from cryptography.hazmat.primitives import serialization

    key = serialization.load_pem_private_key(tls.key.read_bytes(), None)
    lock = serialization.BestAvailableEncryption(b"x")
    form = (serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8)
    tls.key.write_bytes(key.private_bytes(*form, lock))


WRONG: dict[str, tuple[Callable[[FleetKeys, Tls], object], str]] = {
    "no root": (lambda _, tls: tls.root.unlink(), "ca.pem: error: cannot be read (whom to believe): No such file"),
    "no certificate": (lambda _, tls: tls.certificate.unlink(), "cert.pem: error: cannot be read (the certificate)"),
    "no key": (lambda _, tls: tls.key.unlink(), "`argosy keys add-board` makes a machine's folder of keys"),
    "a key for all": (lambda _, tls: tls.key.chmod(0o640), "others on this machine may read the key: `chmod 600"),
    "no PEM": (lambda _, tls: tls.root.write_text("hello"), "ca.pem: error: expected certificates in PEM"),
    "an empty root": (lambda _, tls: tls.root.write_text(""), "ca.pem: error: expected certificates in PEM"),
    "no certificate in it": (lambda _, tls: tls.certificate.write_text("x"), "expected a certificate in PEM, and its"),
    "another's key": (
        lambda fleet, tls: tls.key.write_bytes(fleet.make("pi1").key.read_bytes()),
        "cert.pem: error: is the certificate of another key than",
    ),
    "a locked key": (_locked, "key.pem: error: is protected by a password: a daemon cannot ask for it"),
    "revoked": (
        lambda fleet, tls: fleet.write(tls.key.parent, "pi1", ("pi2", "pi3")),
        "the two are of different fleets, or it was revoked",
    ),
    "expired": (
        lambda fleet, tls: fleet.write(tls.key.parent, "pi1", ends=-5),
        "cert.pem: error: the certificate of `pi1` expired on 20",
    ),
    "not yet valid": (
        lambda fleet, tls: fleet.write(tls.key.parent, "pi1", begins=3600, ends=7200),
        "and this machine's clock says 20",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_each_thing_that_is_wrong_with_keys_is_told_in_words(fleet: FleetKeys, what: str) -> None:
    tls = fleet.make("pi1")
    tls_in(tls.key.parent)
    break_it, words = WRONG[what]
    break_it(fleet, tls)
    with pytest.raises(Findings) as error:
        identity_of(tls, time.time())
    assert words in str(error.value)
    assert "Traceback" not in str(error.value)


def test_keys_of_another_user_are_to_be_given_to_the_daemon(fleet: FleetKeys, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    tls = fleet.make("pi1")
    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(Findings, match=r"Permission denied: keys are for their owner.*`sudo systemd-tmpfiles --create"):
        tls_in(tls.key.parent)


def test_keys_of_another_fleet_with_the_same_names_are_not_believed(fleet: FleetKeys, tmp_path: Path) -> None:
    other, ours = FleetKeys(tmp_path).make("pi1"), fleet.make("pi1")
    with pytest.raises(Findings, match="of different fleets"):
        identity_of(replace(other, root=ours.root), time.time())


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("10.0.0.11:7447", ""),
        ("pi1.field", ""),
        ("[fd00::1]:7000", ""),
        (
            "10.0.0.12",
            "the other boards reach `pi1` at 10.0.0.12, and its certificate is for 10.0.0.11, pi1.field, FD00",
        ),
    ],
)
def test_a_board_takes_its_own_keys_only_and_for_its_own_address(fleet: FleetKeys, address: str, words: str) -> None:
    mission = read_mission(MISSION.replace("ADDRESS", address), Path("m.yaml"))
    tls = fleet.make("pi1", hosts=("10.0.0.11", "pi1.field", "fd00::1"))
    if words:
        with pytest.raises(Findings, match=words):
            check_board(tls, mission, "pi1")
    else:
        check_board(tls, mission, "pi1")
    with pytest.raises(Findings, match="the keys are those of `pi1`, and this is board `pi2`"):
        check_board(tls, mission, "pi2")


@pytest.mark.parametrize("dates", [{"ends": -5.0}, {"begins": 3600.0, "ends": 7200.0}])
def test_a_board_takes_its_keys_whatever_their_dates(fleet: FleetKeys, dates: dict[str, float]) -> None:
    """The other boards refuse it; its own daemons need no certificate, and its clock may be set later."""
    mission = read_mission(MISSION.replace("ADDRESS", "127.0.0.1"), Path("m.yaml"))
    tls = fleet.make("pi1", **dates)  # type: ignore[arg-type]
    check_board(tls, mission, "pi1")
    assert tls_in(tls.key.parent) == tls


def test_a_daemon_reads_its_keys_without_the_package_that_makes_them(fleet: FleetKeys) -> None:
    tls = fleet.make("pi1")
    code = (
        "import sys; sys.modules['cryptography'] = None\n"
        "from pathlib import Path\nfrom commd.bus.tls import tls_in\nimport commd.daemon\n"
        "print(tls_in(Path(sys.argv[1])).key.name)"
    )
    said = subprocess.run([sys.executable, "-c", code, tls.key.parent], capture_output=True, text=True, timeout=60)
    assert (said.stdout, said.stderr) == ("key.pem\n", "")
