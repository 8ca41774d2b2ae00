"""`argosy keys`: create, renew, revoke and show the certificates of a fleet's machines (docs/guides/security.md)."""

from __future__ import annotations

import os
import ssl
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from functools import partial
from getpass import getpass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from argosy.cli.arguments import Command
from argosy.keys.key_index import (
    MACHINES,
    RECORD,
    SECRET,
    SOON_DAYS,
    Kind,
    Member,
    Record,
    believed_in,
    machine_folder,
    read_record,
)
from commd.bus.tls import CERTIFICATE, KEY, ROOT, day, files_in, identity_of
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.findings import Findings, did_you_mean
from schemas.mission.model import Mission, load_mission

if TYPE_CHECKING:
    from argosy.keys.key_store import KeyStore  # imports cryptography

ABOUT = "Certificates of a fleet's machines and operators."
COMMANDS = {
    "init": (
        "create a fleet's certificate authority, and certificates for everybody in its mission",
        "missions/search_and_rescue.yaml",
    ),
    "add-board": (
        "create a certificate for a new board of the mission, or for one that replaces a revoked one",
        "missions/search_and_rescue.yaml pi4",
    ),
    "add-operator": ("create a certificate for an operator of the mission", "missions/search_and_rescue.yaml alice"),
    "add-observer": ("create a certificate for an observer of the mission", "missions/search_and_rescue.yaml eve"),
    "renew": (
        "replace certificates that end soon, or those of the named machines",
        "missions/search_and_rescue.yaml pi1",
    ),
    "revoke": (
        "revoke machines: all others refuse their certificates from then on",
        "missions/search_and_rescue.yaml pi3",
    ),
    "show": (
        "show who has which certificate and until when, for a mission's fleet or one machine's folder",
        "missions/search_and_rescue.yaml",
    ),
}
DAYS = 400
"""Default validity of certificates: a year and a month."""
PASSWORD = "ARGOSY_KEYS_PASSWORD"
"""Environment variable with the password of the fleet's secret, instead of a prompt."""


def load(name: str) -> Command:
    """Return what declares the arguments of a command, and what runs it."""
    kind = name.removeprefix("add-")
    if kind != name:
        return add_add_arguments, partial(add, kind=kind)
    return {
        "init": (add_init_arguments, init),
        "renew": (add_renew_arguments, renew),
        "revoke": (add_revoke_arguments, revoke),
        "show": (add_show_arguments, show),
    }[name]


def add_where(parser: ArgumentParser) -> None:
    """Declare the mission and `--dir`."""
    parser.add_argument("mission", help="mission file: it names the fleet, its boards, operators and observers")
    add_dir(parser)


def add_dir(parser: ArgumentParser) -> None:
    """Declare `--dir`."""
    text = "folder of the fleet's keys (default: argosy/keys/FLEET in the user's data folder)"
    parser.add_argument("--dir", type=Path, metavar="DIR", help=text)


def key_directory(args: Namespace, mission: Mission) -> Path:
    """Return the folder of the fleet's keys."""
    if args.dir is not None:
        return Path(args.dir)
    base = os.environ.get("XDG_DATA_HOME") or (Path.home() / ".local" / "share")
    return Path(base) / "argosy" / "keys" / mission.fleet


def add_init_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy keys init`."""
    add_where(parser)
    text = f"validity of certificates in days (default: {DAYS})"
    parser.add_argument("--days", type=_days, default=DAYS, metavar="N", help=text)
    text = f"encrypt the fleet's secret with a password, prompted for at each use or read from ${PASSWORD}"
    parser.add_argument("--password", action="store_true", help=text)


def add_add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy keys add-board`, `add-operator` and `add-observer`."""
    add_where(parser)
    parser.add_argument("names", nargs="+", metavar="NAME", help="name in the mission")
    _add_address(parser)


def add_renew_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy keys renew`."""
    add_where(parser)
    text = f"machines to renew (default: those whose certificates end within {SOON_DAYS} days)"
    parser.add_argument("names", nargs="*", metavar="NAME", help=text)
    _add_address(parser)


def add_revoke_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy keys revoke`."""
    add_where(parser)
    parser.add_argument("names", nargs="+", metavar="NAME", help="machine to revoke")


def _add_address(parser: ArgumentParser) -> None:
    text = "another host name or IP address of the board; repeatable"
    parser.add_argument("--address", action="append", metavar="HOST", help=text)


def init(args: Namespace) -> int:
    """Create a fleet's authority, and a folder of keys for everybody in its mission."""
    from argosy.keys.key_store import alone, create

    mission = load_mission(args.mission)
    if not mission.boards:
        raise Findings.about(mission.path, "the mission declares no `boards`: only boards need keys")
    path = key_directory(args, mission)
    password = _new_password() if args.password else None
    with alone(path):
        folder = create(path, mission.fleet, args.days, password)
        for name, kind in everybody(mission).items():
            folder.add(name, kind, hosts_of(mission, name))
    _print_members(folder, list(everybody(mission)))
    print(f"copy each folder in {machine_folder(path, '')} to its machine, and to no other (docs/guides/security.md)")
    print(f"{path / 'ca.key'} is the fleet's secret: keep it here and in your backup only")
    return EXIT_DONE


def add(args: Namespace, kind: str) -> int:
    """Create certificates for members of a kind that have none."""
    mission = load_mission(args.mission)
    known = [name for name, its in everybody(mission).items() if its == kind]
    _check_names(mission, args.names, known, kind)
    with _opened(args, mission) as folder:
        for name in args.names:
            folder.add(name, cast("Kind", kind), hosts_of(mission, name), tuple(args.address or ()))
        _print_members(folder, args.names)
        others = [name for name in _boards(folder) if name not in args.names]
        whom = ", ".join(args.names)
        _print_anchors(folder, others, f"copy these files to the boards and restart commd, so that they accept {whom}:")
        if kind == "board":
            _print_anchors(
                folder, _people(folder), f"copy these files to operators and observers, who then accept {whom}:"
            )
        if others:
            print(f"each of these boards also needs a new router.json5 with the rights of {whom}: argosy units")
    return EXIT_DONE


def renew(args: Namespace) -> int:
    """Replace the certificates of some members, or those that end soon."""
    mission = load_mission(args.mission)
    with _opened(args, mission) as folder:
        believed = folder.record.believed
        _check_names(mission, args.names, list(believed), "machine with a certificate")
        soon = datetime.now(UTC) + timedelta(days=SOON_DAYS)
        names = args.names or [name for name, member in believed.items() if member.ends < soon]
        for name in names:
            folder.renew(name, hosts_of(mission, name), None if args.address is None else tuple(args.address))
        _print_members(folder, names)
        if not names:
            print(f"no certificate ends within {SOON_DAYS} days")
        for name in names:
            files = f"{KEY} and {CERTIFICATE} of {folder.machine(name)}"
            print(f"copy {files} to `{name}` and restart its commd; other machines need nothing")
    return EXIT_DONE


def revoke(args: Namespace) -> int:
    """Revoke members: machines with the new anchors refuse them."""
    mission = load_mission(args.mission)
    with _opened(args, mission) as folder:
        _check_names(mission, args.names, list(folder.record.members), "machine that was given a certificate")
        for name in args.names:
            folder.revoke(name)
        whom = ", ".join(args.names)
        print(f"revoked: {whom}")
        _print_anchors(
            folder, _boards(folder), f"copy these files to the boards and restart commd, so that they refuse {whom}:"
        )
        if any(its.kind == "board" for name, its in folder.record.members.items() if name in args.names):
            _print_anchors(
                folder, _people(folder), f"copy these files to operators and observers, who then refuse {whom}:"
            )
    return EXIT_DONE


def everybody(mission: Mission) -> dict[str, Kind]:
    """Return everybody in the mission who needs a certificate."""
    kinds: dict[str, Kind] = dict.fromkeys(mission.boards, "board")
    kinds |= dict.fromkeys(mission.security.operators, "operator")
    return kinds | dict.fromkeys(mission.security.observers, "observer")


def hosts_of(mission: Mission, name: str) -> tuple[str, ...]:
    """Return the hosts of a board: its address in the mission, NAME and NAME.local."""
    from argosy.keys.certificate_authority import is_host

    if name not in mission.boards:
        return ()
    own = [host for host in (name, f"{name}.local") if is_host(host)]
    return tuple(dict.fromkeys(filter(None, (mission.host_of(name), *own))))


@contextmanager
def _opened(args: Namespace, mission: Mission) -> Iterator[KeyStore]:
    """Open and lock the fleet's keys. Raises Findings."""
    from argosy.keys.certificate_authority import Authority
    from argosy.keys.key_store import KeyStore, alone, read_secret

    path = key_directory(args, mission)
    read_record(path, mission.fleet)
    with alone(path):
        pem = read_secret(path)
        password = _asked("password of the fleet's secret: ") if b"ENCRYPTED" in pem else None
        try:
            authority = Authority.read(pem, password.encode() if password is not None else None)
        except (ValueError, TypeError):
            raise Findings.about(
                path / SECRET, "the fleet's secret cannot be used: wrong password, or an invalid file"
            ) from None
        folder = KeyStore(path, read_record(path, mission.fleet), authority)
        if behind := folder.record.out_of_step(path):
            folder.spread()
            _print_anchors(folder, behind, "completed an interrupted command; copy these files to their machines:")
        yield folder


def _check_names(mission: Mission, names: Sequence[str], known: Sequence[str], what: str) -> None:
    for name in names:
        if name not in known:
            raise Findings.about(mission.path, f"there is no {what} `{name}`{did_you_mean(name, known)}")


def _boards(folder: KeyStore) -> list[str]:
    return [name for name, member in folder.record.believed.items() if member.kind == "board"]


def _people(folder: KeyStore) -> list[str]:
    return [name for name, member in folder.record.believed.items() if member.kind != "board"]


def _print_members(folder: KeyStore, names: Sequence[str]) -> None:
    for name in names:
        print(f"{name}: {described(folder.record.members[name])}: {folder.machine(name)}")


def described(member: Member) -> str:
    """Return a certificate's kind, end and hosts as text."""
    hosts = f", for {', '.join(member.hosts)}" if member.hosts else ""
    which = f" (number {member.generation} of this name)" if member.generation > 1 else ""
    return f"{member.kind}{which} until {member.ends:%Y-%m-%d}{hosts}"


def _print_anchors(folder: KeyStore, names: Sequence[str], words: str) -> None:
    if names:
        print(words)
    for name in names:
        print(f"  {name}: {folder.machine(name) / ROOT}")


def _new_password() -> bytes:
    first = _asked("new password of the fleet's secret: ")
    if PASSWORD not in os.environ and first != _asked("once more: "):
        raise Findings.about("--password", "the passwords differ: nothing was changed")
    if not first:
        raise Findings.about("--password", "the password is empty: nothing was done")
    return first.encode()


def _asked(prompt: str) -> str:
    if (given := os.environ.get(PASSWORD)) is not None:
        return given
    if not sys.stdin.isatty():
        raise Findings.about("--password", f"there is no terminal to ask for the password: set {PASSWORD}")
    return getpass(prompt)


def _days(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= 3650):
        raise ArgumentTypeError(f"expected 1 to 3650 days, got `{text}`")
    return int(text)


def add_show_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy keys show`."""
    parser.add_argument("mission", metavar="MISSION|FOLDER", help="mission file, or a machine's folder of keys")
    add_dir(parser)


def show(args: Namespace) -> int:
    """Print all certificates. Returns 1 if one needs attention."""
    if Path(args.mission).is_dir():
        return _show_folder(Path(args.mission))
    mission = load_mission(args.mission)
    path = key_directory(args, mission)
    record = read_record(path, mission.fleet)
    print(f"fleet {record.fleet}: {path}")
    wide = max(map(len, (*record.members, *everybody(mission))), default=0)
    todo, behind = False, record.out_of_step(path)
    for name, member in record.members.items():
        problem = _problem(mission, record, name, member) or _halves(path, name, member)
        todo |= bool(problem)
        print(f"  {name:{wide}}  {member.kind:8}  {_state(member)}  {', '.join(member.hosts)}".rstrip())
        if problem:
            print(f"  {'':{wide}}  {problem}")
    for name, kind in everybody(mission).items():
        if name not in record.members:
            todo = True
            print(f"  {name:{wide}}  {kind:8}  has no certificate: `argosy keys add-{kind} {args.mission} {name}`")
    if behind:
        text = "a command was interrupted; the next `add-...`, `renew` or `revoke` completes it"
        print(f"  {ROOT} of {', '.join(behind)} is not up to date: {text}")
    return EXIT_FAILED if todo or behind else EXIT_DONE


def _show_folder(folder: Path) -> int:
    if (folder / RECORD).exists():
        within = ", ".join(sorted(map(str, (folder / MACHINES).glob("*")))) or "none yet"
        text = f"this is the folder of all keys of a fleet: `argosy keys show MISSION --dir {folder}` shows them"
        raise Findings.about(folder, f"{text}; those of its machines: {within}")
    tls = files_in(folder)
    identity = identity_of(tls, now := time.time())
    hosts = f", for {', '.join(identity.addresses)}" if identity.addresses else ""
    print(f"{identity.name}: until {day(identity.ends)}{hosts}")
    try:
        print(f"accepts: {', '.join(believed_in(folder / ROOT))}")
    except (OSError, ssl.SSLError):
        print(f"accepts the machines in {folder / ROOT}")
    return EXIT_FAILED if identity.ends - now < SOON_DAYS * 86_400 else EXIT_DONE


def _state(member: Member) -> str:
    if member.revoked is not None:
        return f"revoked {member.revoked:%Y-%m-%d}"
    days = (member.ends - datetime.now(UTC)).days
    return f"until {member.ends:%Y-%m-%d} ({days} days)"


def _halves(path: Path, name: str, member: Member) -> str:
    """Return the problem of a key that does not match its certificate, as after an interrupted `renew`, or ""."""
    files = files_in(machine_folder(path, name))
    if member.revoked is not None or not (files.key.exists() and files.certificate.exists()):
        return ""  # such as after a copy
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(files.certificate, files.key)
    except (OSError, ssl.SSLError):
        return f"{KEY} does not match {CERTIFICATE}: replace both with `argosy keys renew`"
    return ""


def _problem(mission: Mission, record: Record, name: str, member: Member) -> str:
    """Return what to do about a member; empty = nothing."""
    if member.revoked is not None:
        return f"add it again: `argosy keys add-{member.kind}`" if name in everybody(mission) else ""
    if name not in everybody(mission):
        return "is no longer in the mission: revoke it with `argosy keys revoke`"
    if everybody(mission)[name] != member.kind:
        return f"is an {everybody(mission)[name]} in the mission: revoke it, and add it as that"
    left = member.ends - datetime.now(UTC)
    if left <= timedelta(0):
        return "EXPIRED: every machine refuses it; replace it with `argosy keys renew`"
    if left < timedelta(days=SOON_DAYS):
        return "ends soon: replace it with `argosy keys renew`"
    host = mission.host_of(name)
    if host and host not in member.hosts:
        return f"its address in the mission is {host}: replace the certificate with `argosy keys renew`"
    return ""
