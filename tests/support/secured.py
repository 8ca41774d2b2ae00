"""A fleet as it is deployed: keys of its own, mutual TLS between boards, a socket on each, and access control."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from argosy.__main__ import main as argosy
from commd.bus.tls import Tls, files_in
from commd.router.config import router_settings, write
from schemas.mission.model import Mission, load_mission
from tests.boards.network import Network
from tests.support.ports import free_port
from tests.support.processes import ROOT, Daemon

FLEET = """
mission: three
security: {operators: [ops], observers: [eye]}
boards: BOARDS
agents:
  a: {board: pi1, program: nothing.asl, robot: r1}
  b: {board: pi2, program: nothing.asl, robot: r2}
  c: {board: pi3, program: nothing.asl, robot: r3}
robots:
  r1: {board: pi1, manifest: turtle, prefix: r1}
  r2: {board: pi2, manifest: turtle, prefix: r2}
  r3: {board: pi3, manifest: turtle, prefix: r3}
"""
"""A mission of three boards, each with an agent and its robot, as a text with its boards to be filled in."""


class Secured:
    """A secured fleet: three boards `pi1` to `pi3`, on loopback each at a port of its own, or in namespaces."""

    def __init__(self, text: str = FLEET, programs: Path | None = None, network: Network | None = None) -> None:
        """`text` has `boards: BOARDS`; `programs` is a folder that the mission's paths begin with."""
        self._network = network
        self.folder = Path(tempfile.mkdtemp(prefix="argosy-"))  # the path of a socket has 107 bytes at most
        if programs is not None:
            (self.folder / programs.name).symlink_to(programs)
        (self.folder / "nothing.asl").write_text("")
        self.ports = {board: free_port() for board in ("pi1", "pi2", "pi3")}
        boards = ", ".join(f'{board}: {{address: "{self._host(board)}:{port}"}}' for board, port in self.ports.items())
        self.path = self.folder / "mission.yaml"
        self.path.write_text(re.sub("BOARDS", f"{{{boards}}}", text), encoding="utf-8")
        self.mission: Mission = load_mission(self.path)
        self.daemons: list[Daemon] = []
        assert argosy(["keys", "init", str(self.path), "--dir", str(self.folder / "keys")]) == 0

    def __enter__(self) -> Secured:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for daemon in self.daemons:
            daemon.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def keys(self, name: str) -> Path:
        """The folder of keys of a board, operator or observer."""
        return self.folder / "keys" / "machines" / name

    def tls(self, name: str) -> Tls:
        """The keys of a board, operator or observer."""
        return files_in(self.keys(name))

    def link(self, board: str) -> str:
        """Where other machines reach a board."""
        return f"tls/{self._host(board)}:{self.ports[board]}"

    def _host(self, board: str) -> str:
        return "127.0.0.1" if self._network is None else self._network.addresses[board]

    def socket(self, board: str) -> str:
        """Where the daemons of a board reach its router."""
        return f"unixsock-stream/{self.folder}/{board}.sock"

    def settings(self, board: str) -> dict[str, Any]:
        """The settings of a board's router."""
        socket = self.socket(board).partition("/")[2]
        return router_settings(self.mission, board, socket=socket, keys=self.keys(board))

    def config(self, board: str) -> Path:
        """Write the configuration of a board's router."""
        file = self.folder / f"{board}.json5"
        file.write_text(write(self.settings(board)), encoding="utf-8")
        return file

    def start(self, board: str, daemon: str, *options: str) -> Daemon:
        """Start a daemon of a board, and return at once."""
        how = ("--config", str(self.config(board))) if daemon == "commd" else ("--router", self.socket(board))
        state = ("--state", str(self.folder / "state" / board))
        return self.run(daemon, "serve", str(self.path), "--board", board, *state, *how, *options, on=board)

    def run(self, *arguments: str, on: str = "") -> Daemon:
        """Start a process of the fleet, in namespaces `on` a board, and return at once."""
        within = self._network.within(on) if self._network is not None else ()
        self.daemons.append(Daemon(*arguments, within=within, code=ROOT))
        return self.daemons[-1]

    def routers(self, boards: Sequence[str] = ("pi1", "pi2", "pi3")) -> None:
        """Start commd on each board, and wait until they serve."""
        started = [self.start(board, "commd") for board in boards]
        for daemon in started:
            daemon.says("router board=")
