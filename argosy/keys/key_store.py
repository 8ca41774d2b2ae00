"""The operator's folder of the fleet's keys.

`ca.key` is the fleet's secret and never leaves this folder; `fleet.json` records all certificates; `machines/NAME` is
copied to the machine of that name. Files are written atomically, and readable by their owner alone.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec

from argosy.keys.certificate_authority import Authority, Machine
from argosy.keys.key_index import RECORD, SECRET, Kind, Member, Record, machine_folder, read_record
from commd.bus.tls import CERTIFICATE, KEY, ROOT
from commd.process.state_dir import replace_file
from schemas.files.findings import Findings


class KeyStore:
    """A fleet's keys on the operator's machine."""

    def __init__(self, path: Path, record: Record, authority: Authority) -> None:
        self.path, self.record, self._authority = path, record, authority

    def machine(self, name: str) -> Path:
        """Return the folder to copy to a machine."""
        return machine_folder(self.path, name)

    def add(self, name: str, kind: Kind, hosts: tuple[str, ...], addresses: tuple[str, ...] = ()) -> None:
        """Create a certificate for a new member, or for one that replaces a revoked one.

        It is valid for the `hosts` of the mission and for further `addresses`. Raises Findings if the name has one.
        """
        before = self.record.members.get(name)
        if before is not None and before.revoked is None:
            text = f"`{name}` already has a certificate: replace it with `argosy keys renew`, or `revoke` it first"
            raise Findings.about(self.machine(name), text)
        generation = 1 if before is None else before.generation + 1
        self._certify(name, kind, generation, hosts, addresses)
        self.spread()

    def renew(self, name: str, hosts: tuple[str, ...], addresses: tuple[str, ...] | None = None) -> None:
        """Create a new key and certificate of a member; the other machines need no change.

        Keeps its further `addresses` unless others are given.
        """
        member = self.record.members[name]
        kept = member.addresses if addresses is None else addresses
        self._certify(name, member.kind, member.generation, hosts, kept)

    def revoke(self, name: str) -> None:
        """Revoke a member: remove its anchor from the folders of all others. Repeat it after an interruption."""
        if self.record.members[name].revoked is None:
            now = datetime.now(UTC).replace(microsecond=0)
            self._keep(name, msgspec.structs.replace(self.record.members[name], revoked=now))
        self.spread()
        shutil.rmtree(self.machine(name), ignore_errors=True)

    def spread(self) -> None:
        """Write the `ca.pem` of each machine."""
        believed = sorted(self.record.believed.items())
        anchors = {name: self._authority.anchor(self._machine(name, its)) for name, its in believed}
        for name in anchors:
            whom = self.record.anchors(name)
            _write(self.machine(name) / ROOT, b"".join(pem for other, pem in anchors.items() if other in whom))

    def _certify(self, name: str, kind: Kind, generation: int, hosts: tuple[str, ...], more: tuple[str, ...]) -> None:
        ends = (datetime.now(UTC) + timedelta(days=self.record.days)).replace(microsecond=0)
        every = tuple(dict.fromkeys((*hosts, *more)))
        member = Member(kind=kind, generation=generation, hosts=every, addresses=more, ends=ends)
        try:
            pair = self._authority.certify(self._machine(name, member), ends)
        except ValueError as error:
            raise Findings.about(self.machine(name), str(error)) from None
        folder = self.machine(name)
        _folder(folder.parent)
        _write(folder / KEY, pair.key)
        _write(folder / CERTIFICATE, pair.certificate)
        self._keep(name, member)

    def _machine(self, name: str, member: Member) -> Machine:
        return Machine(self.record.fleet, name, member.generation, member.kind == "board", member.hosts)

    def _keep(self, name: str, member: Member) -> None:
        self.record = msgspec.structs.replace(self.record, members={**self.record.members, name: member})
        _write(self.path / RECORD, msgspec.json.format(msgspec.json.encode(self.record)) + b"\n")


def create(path: Path, fleet: str, days: int, password: bytes | None) -> KeyStore:
    """Create the fleet's secret in a folder that is locked by `alone`; its certificates hold for `days` days.

    Raises Findings if there is one: it is never overwritten. The record is written first, so a record without a secret
    comes from an interrupted command, and no certificate exists.
    """
    if (path / SECRET).exists() or ((path / RECORD).exists() and read_record(path, fleet).members):
        text = "a fleet's keys are here already; new ones would invalidate all its certificates: nothing was changed"
        raise Findings.about(path, f"{text}; `argosy keys show` lists missing certificates")
    authority = Authority.new()
    folder = KeyStore(path, Record(fleet=fleet, days=days), authority)
    _write(path / RECORD, msgspec.json.format(msgspec.json.encode(folder.record)) + b"\n")
    _write(path / SECRET, authority.secret(password))
    return folder


def read_secret(path: Path) -> bytes:
    """Return the content of the secret's file. Raises Findings if it is readable by others."""
    file = path / SECRET
    try:
        pem = file.read_bytes()
        mode = stat.S_IMODE(file.stat().st_mode)
    except OSError as error:
        text = f"the fleet's secret cannot be read ({error.strerror}): it is needed to create certificates"
        raise Findings.about(file, text) from None
    if mode & 0o077:
        raise Findings.about(file, f"other users of this machine can read the fleet's secret: run `chmod 600 {file}`")
    return pem


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Lock the folder against a second `argosy keys`; create it if needed. Raises Findings if it is locked."""
    _folder(path)
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise Findings.about(path, "another `argosy keys` is using this folder: wait for it") from None
    finally:
        os.close(descriptor)


def _folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(mode=0o700, exist_ok=True)
        path.chmod(0o700)
    except OSError as error:
        raise Findings.about(path, f"cannot be created: {error.strerror}") from None


def _write(file: Path, content: bytes) -> None:
    """Write a file as a whole or not at all, readable by its owner alone. Raises Findings."""
    _folder(file.parent)
    try:
        replace_file(file, content)
    except OSError as error:
        raise Findings.about(file, f"cannot be written: {error.strerror}") from None
