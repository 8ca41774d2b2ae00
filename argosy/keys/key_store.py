"""The folder where the operator keeps the fleet's keys: the secret, who has a certificate, and a folder for each.

`ca.key` is the fleet's secret and leaves this folder never; `fleet.json` says who was given what; `machines/NAME` is
what is copied to the machine of that name. Each file appears whole or not at all, and can be read by its owner alone.
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
from argosy.keys.key_index import RECORD, SECRET, Kind, Member, Record, machine_folder, read_record, wrong
from commd.bus.tls import CERTIFICATE, KEY, ROOT


class KeyStore:
    """A fleet's keys on the operator's machine."""

    def __init__(self, path: Path, record: Record, authority: Authority) -> None:
        self.path, self.record, self._authority = path, record, authority

    def machine(self, name: str) -> Path:
        """Return the folder that is copied to a machine."""
        return machine_folder(self.path, name)

    def add(self, name: str, kind: Kind, hosts: tuple[str, ...], addresses: tuple[str, ...] = ()) -> None:
        """Make a certificate for somebody new, or for who has the name of somebody revoked.

        It is for the `hosts` of the mission and for further `addresses`. Raises Findings for a name that is taken.
        """
        before = self.record.members.get(name)
        if before is not None and before.revoked is None:
            text = f"`{name}` has a certificate already: `argosy keys renew` makes it a new one, `revoke` disowns it"
            raise wrong(self.machine(name), text)
        generation = 1 if before is None else before.generation + 1
        self._certify(name, kind, generation, hosts, addresses)
        self.spread()

    def renew(self, name: str, hosts: tuple[str, ...], addresses: tuple[str, ...] | None = None) -> None:
        """Make a new key and certificate for somebody; nobody else needs anything new.

        Further `addresses` are as they were unless others are given.
        """
        member = self.record.members[name]
        kept = member.addresses if addresses is None else addresses
        self._certify(name, member.kind, member.generation, hosts, kept)

    def revoke(self, name: str) -> None:
        """Disown somebody: the folders of all others no longer hold the anchor. To do so again finishes it."""
        if self.record.members[name].revoked is None:
            now = datetime.now(UTC).replace(microsecond=0)
            self._keep(name, msgspec.structs.replace(self.record.members[name], revoked=now))
        self.spread()
        shutil.rmtree(self.machine(name), ignore_errors=True)

    def spread(self) -> None:
        """Write whom to believe into the folder of each machine."""
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
            raise wrong(self.machine(name), str(error)) from None
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
    """Make the fleet's secret in a folder that is ours `alone`.

    Raises Findings if there is one already: it is never overwritten. The record is written before it, so that one
    without a secret is of a command that was interrupted, and nothing was made with it.
    """
    if (path / SECRET).exists() or ((path / RECORD).exists() and read_record(path, fleet).members):
        text = "a fleet's keys are here already, and whoever has certificates of them would be lost: nothing was done"
        raise wrong(path, f"{text}; `argosy keys show` says whether any are missing")
    authority = Authority.new()
    folder = KeyStore(path, Record(fleet=fleet, days=days), authority)
    _write(path / RECORD, msgspec.json.format(msgspec.json.encode(folder.record)) + b"\n")
    _write(path / SECRET, authority.secret(password))
    return folder


def read_secret(path: Path) -> bytes:
    """Return what is in the file of the fleet's secret. Raises Findings if others may read it, too."""
    file = path / SECRET
    try:
        pem = file.read_bytes()
        mode = stat.S_IMODE(file.stat().st_mode)
    except OSError as error:
        text = f"the fleet's secret cannot be read ({error.strerror}): no certificate can be made without it"
        raise wrong(file, text) from None
    if mode & 0o077:
        raise wrong(file, f"others on this machine may read the fleet's secret: `chmod 600 {file}`")
    return pem


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Keep a second `argosy keys` from the folder, which is made if need be. Raises Findings if one is at work."""
    _folder(path)
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise wrong(path, "another `argosy keys` is at work here: wait for it") from None
    finally:
        os.close(descriptor)


def _folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(mode=0o700, exist_ok=True)
        path.chmod(0o700)
    except OSError as error:
        raise wrong(path, f"cannot be made: {error.strerror}") from None


def _write(file: Path, content: bytes) -> None:
    """Put a file in place whole, for its owner alone. Raises Findings."""
    part = file.with_name(f".{file.name}.part")
    _folder(file.parent)
    try:
        part.unlink(missing_ok=True)
        descriptor = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "wb") as out:
            out.write(content)
            out.flush()
            os.fsync(out.fileno())
        part.replace(file)
        folder = os.open(file.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise wrong(file, f"cannot be written: {error.strerror}") from None
