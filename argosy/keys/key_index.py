"""Who of a fleet was given keys: the operator's record, and whom a machine's own folder believes."""

from __future__ import annotations

import ssl
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from commd.bus.tls import ROOT, SOON
from schemas.files.findings import Finding, Findings

RECORD, SECRET, MACHINES = "fleet.json", "ca.key", "machines"
SOON_DAYS = round(SOON / 86_400)
"""A certificate that ends within so many days is to be made anew."""

Kind: TypeAlias = Literal["board", "operator", "observer"]


class Member(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A machine that was given a certificate."""

    kind: Kind
    generation: Annotated[int, msgspec.Meta(ge=1)]
    hosts: tuple[str, ...] = ()
    """Host names and IP addresses that its certificate is for."""
    addresses: tuple[str, ...] = ()
    """Those of them that the mission does not say."""
    ends: datetime
    revoked: datetime | None = None


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Who was given what."""

    fleet: str
    days: int
    """For which certificates are made."""
    members: dict[str, Member] = {}

    @property
    def believed(self) -> dict[str, Member]:
        """Those that are not revoked."""
        return {name: member for name, member in self.members.items() if member.revoked is None}

    def anchors(self, name: str) -> dict[str, Member]:
        """Whom a machine is to believe: boards believe everybody, people the boards alone."""
        if self.believed[name].kind == "board":
            return self.believed
        return {other: its for other, its in self.believed.items() if its.kind == "board" or other == name}

    def out_of_step(self, path: Path) -> list[str]:
        """Return whose `ca.pem` is not as the record says, as after a command that was interrupted.

        Folders that are no longer there, such as after a copy, are not looked at.
        """
        return [
            name
            for name in self.believed
            if machine_folder(path, name).is_dir()
            and _believes(machine_folder(path, name) / ROOT)
            != sorted(_called(other, str(its.generation)) for other, its in self.anchors(name).items())
        ]


def machine_folder(path: Path, name: str) -> Path:
    """Return the folder that is copied to a machine."""
    return path / MACHINES / name


def read_record(path: Path, fleet: str) -> Record:
    """Read who was given what. Raises Findings in words."""
    try:
        record = msgspec.json.decode((path / RECORD).read_bytes(), type=Record)
    except FileNotFoundError:
        if (path / SECRET).exists():
            text = f"is missing, and {SECRET} is there: take it from your backup, or begin anew in another folder"
            raise wrong(path / RECORD, text) from None
        text = f"no keys of fleet `{fleet}` are here: `argosy keys init` makes them, --dir says where they are"
        raise wrong(path, text) from None
    except OSError as error:
        raise wrong(path / RECORD, f"cannot be read: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise wrong(path / RECORD, f"is not what `argosy keys` wrote: {error}") from None
    if record.fleet != fleet:
        raise wrong(path, f"the keys here are of fleet `{record.fleet}`, and the mission's is `{fleet}`")
    return record


def believed_in(file: Path) -> list[str]:
    """Return whom a machine believes, by its `ca.pem`. Raises ssl.SSLError or OSError for a file of something else."""
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


def wrong(file: Path, text: str) -> Findings:
    """Return an error about a file or folder."""
    return Findings([Finding(str(file), 0, 0, text)])
