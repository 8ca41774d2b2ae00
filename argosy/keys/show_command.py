"""`argosy keys show`: who has which certificate, and until when."""

from __future__ import annotations

import ssl
import time
from argparse import ArgumentParser, Namespace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from argosy.keys.certificate_commands import add_dir, everybody, key_directory
from argosy.keys.key_index import SOON_DAYS, Member, Record, believed_in, machine_folder, read_record
from commd.bus.tls import CERTIFICATE, KEY, ROOT, day, files_in, identity_of
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.units import host_and_port
from schemas.mission.model import DEFAULT_PORT, Mission, load_mission


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy keys show`."""
    parser.add_argument("mission", metavar="MISSION|FOLDER", help="mission file, or a machine's folder of keys")
    add_dir(parser)


def run(args: Namespace) -> int:
    """Print who has which certificate. Returns 1 if something is to be done about one."""
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
        text = "a command was interrupted; the next `add-...`, `renew` or `revoke` (again) finishes it"
        print(f"  {ROOT} of {', '.join(behind)}: believes others than it is to: {text}")
    return EXIT_FAILED if todo or behind else EXIT_DONE


def _show_folder(folder: Path) -> int:
    tls = files_in(folder)
    identity = identity_of(tls, now := time.time())
    hosts = f", for {', '.join(identity.addresses)}" if identity.addresses else ""
    print(f"{identity.name}: until {day(identity.ends)}{hosts}")
    try:
        print(f"believes: {', '.join(believed_in(folder / ROOT))}")
    except (OSError, ssl.SSLError):
        print(f"believes whom {folder / ROOT} names")
    return EXIT_FAILED if identity.ends - now < SOON_DAYS * 86_400 else EXIT_DONE


def _state(member: Member) -> str:
    if member.revoked is not None:
        return f"revoked {member.revoked:%Y-%m-%d}"
    days = (member.ends - datetime.now(UTC)).days
    return f"until {member.ends:%Y-%m-%d} ({days} days)"


def _halves(path: Path, name: str, member: Member) -> str:
    """Return in words that a key and its certificate are not of one another, as after an interrupted `renew`."""
    files = files_in(machine_folder(path, name))
    if member.revoked is not None or not (files.key.exists() and files.certificate.exists()):
        return ""  # such as after a copy
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_cert_chain(files.certificate, files.key)
    except (OSError, ssl.SSLError):
        return f"{KEY} and {CERTIFICATE} are not of one another: `argosy keys renew` of it makes new ones"
    return ""


def _problem(mission: Mission, record: Record, name: str, member: Member) -> str:
    """Return in words what is to be done about a member, if anything is."""
    if member.revoked is not None:
        return f"add it again: `argosy keys add-{member.kind}`" if name in everybody(mission) else ""
    if name not in everybody(mission):
        return "is not in the mission any more: `argosy keys revoke` disowns it"
    if everybody(mission)[name] != member.kind:
        return f"is an {everybody(mission)[name]} in the mission: revoke it, and add it as that"
    left = member.ends - datetime.now(UTC)
    if left <= timedelta(0):
        return "EXPIRED: no machine lets it in; `argosy keys renew` makes it a new one"
    if left < timedelta(days=SOON_DAYS):
        return "ends soon: `argosy keys renew` makes it a new one"
    address = mission.boards[name].address if name in mission.boards else ""
    host = host_and_port(address, DEFAULT_PORT)[0].strip("[]") if address else ""
    if host and host not in member.hosts:
        return f"the mission says it is at {host}: `argosy keys renew` makes it a certificate for that"
    return ""
