"""The operator's record of issued certificates, and the anchors in a machine's own folder."""

from __future__ import annotations

import ssl
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from commd.bus.tls import ROOT, SOON
from schemas.files.findings import Findings

RECORD, SECRET, MACHINES = "fleet.json", "ca.key", "machines"
SOON_DAYS = round(SOON / 86_400)
"""Days before its end at which a certificate should be renewed."""

Kind: TypeAlias = Literal["board", "operator", "observer"]


class Member(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A machine with a certificate."""

    kind: Kind
    generation: Annotated[int, msgspec.Meta(ge=1)]
    hosts: tuple[str, ...] = ()
    """Host names and IP addresses in its certificate."""
    addresses: tuple[str, ...] = ()
    """Those of them that are not in the mission."""
    ends: datetime
    revoked: datetime | None = None


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All certificates of a fleet."""

    fleet: str
    days: int
    """Validity of new certificates in days."""
    members: dict[str, Member] = {}

    @property
    def believed(self) -> dict[str, Member]:
        """The members that are not revoked."""
        return {name: member for name, member in self.members.items() if member.revoked is None}

    def anchors(self, name: str) -> dict[str, Member]:
        """Return the members that a machine should accept: a board accepts all, a person only boards."""
        if self.believed[name].kind == "board":
            return self.believed
        return {other: its for other, its in self.believed.items() if its.kind == "board" or other == name}

    def out_of_step(self, path: Path) -> list[str]:
        """Return the machines whose `ca.pem` differs from the record, as after an interrupted command.

        Ignores folders that no longer exist: they may be deleted after the copy.
        """
        return [
            name
            for name in self.believed
            if machine_folder(path, name).is_dir()
            and _believes(machine_folder(path, name) / ROOT)
            != sorted(_called(other, str(its.generation)) for other, its in self.anchors(name).items())
        ]


def machine_folder(path: Path, name: str) -> Path:
    """Return the folder to copy to a machine."""
    return path / MACHINES / name


def read_record(path: Path, fleet: str) -> Record:
    """Read the record. Raises Findings."""
    try:
        record = msgspec.json.decode((path / RECORD).read_bytes(), type=Record)
    except FileNotFoundError:
        if (path / SECRET).exists():
            text = f"is missing, but {SECRET} exists: restore it from your backup, or start again in another folder"
            raise Findings.about(path / RECORD, text) from None
        text = (
            f"no keys of fleet `{fleet}` are here: create them with `argosy keys init`, or name their folder by --dir"
        )
        raise Findings.about(path, text) from None
    except OSError as error:
        raise Findings.about(path / RECORD, f"cannot be read: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise Findings.about(path / RECORD, f"was not written by `argosy keys`: {error}") from None
    if record.fleet != fleet:
        raise Findings.about(path, f"the keys here belong to fleet `{record.fleet}`, the mission has fleet `{fleet}`")
    return record


def believed_in(file: Path) -> list[str]:
    """Return the machines accepted by a `ca.pem`. Raises ssl.SSLError or OSError for an invalid file."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(file)
    names = []
    anchors: list[dict[str, Any]] = context.get_ca_certs()
    for anchor in anchors:
        subject = {field: value for part in anchor["subject"] for field, value in part}
        which = str(subject.get("organizationalUnitName", "")).removeprefix("keys ")
        names.append(_called(str(subject.get("commonName", "?")), which))
    return sorted(names)


def _called(name: str, generation: str) -> str:
    return f"{name} ({generation})" if generation not in ("", "1") else name


def _believes(file: Path) -> list[str] | None:
    try:
        return believed_in(file)
    except (OSError, ssl.SSLError):
        return None
