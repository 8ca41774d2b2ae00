"""Keys for tests of what machines make of each other's: good ones, and each kind of bad ones, without the command."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from argosy.keys.certificate_authority import Authority, Machine
from commd.bus.tls import CERTIFICATE, KEY, ROOT, Tls, files_in

HOSTS = ("127.0.0.1",)


class FleetKeys:
    """A fleet's authority, and folders of keys that it makes."""

    def __init__(self, folder: Path, fleet: str = "test") -> None:
        self.folder, self.fleet, self.authority = folder, fleet, Authority.new()
        self._made = 0

    def machine(self, name: str, hosts: Sequence[str] = HOSTS, generation: int = 1) -> Machine:
        return Machine(self.fleet, name, generation, True, tuple(hosts))

    def make(
        self,
        name: str,
        believes: Sequence[str | Machine] = ("pi1", "pi2", "pi3"),
        *,
        hosts: Sequence[str] = HOSTS,
        ends: float = 3600.0,
        begins: float | None = None,
        generation: int = 1,
    ) -> Tls:
        """Make a folder for `name`, whose certificate ends in `ends` seconds and is valid since long ago."""
        self._made += 1
        folder = self.folder / f"{name}-{self._made}"
        folder.mkdir(parents=True, mode=0o700)
        self.write(folder, name, believes, hosts=hosts, ends=ends, begins=begins, generation=generation)
        return files_in(folder)

    def write(
        self,
        folder: Path,
        name: str,
        believes: Sequence[str | Machine] = ("pi1", "pi2", "pi3"),
        *,
        hosts: Sequence[str] = HOSTS,
        ends: float = 3600.0,
        begins: float | None = None,
        generation: int = 1,
    ) -> None:
        """Write, or write anew, what is in a folder."""
        now = datetime.now(UTC)
        signer = self.authority if begins is None else self.authority.at(now + timedelta(seconds=begins, days=2 * 365))
        pair = signer.certify(self.machine(name, hosts, generation), now + timedelta(seconds=ends))
        whom = [one if isinstance(one, Machine) else self.machine(one) for one in believes]
        (folder / ROOT).write_bytes(b"".join(map(self.authority.anchor, whom)))
        (folder / CERTIFICATE).write_bytes(pair.certificate)
        (folder / KEY).touch(mode=0o600)
        (folder / KEY).write_bytes(pair.key)
