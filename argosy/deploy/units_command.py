"""`argosy units`: writes what a board needs to run its part of a mission under systemd, as a tree for its root."""

from __future__ import annotations

import re
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from pathlib import Path

from argosy.check.command import check_mission
from argosy.check.fleet_rules import AFTER_RESTART
from argosy.deploy.board_files import files_of, secrets_of
from argosy.deploy.board_guide import guide
from argosy.deploy.firewall import firewall_files
from argosy.deploy.unit_files import VENV, Board, unit_files
from commd.daemon import chosen
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from commd.router import config
from schemas.files.findings import Finding, Findings
from schemas.mission.model import Mission, load_mission

GUIDE = "INSTALL.md"
TAKEN = {"router.json5", "board.env", "firewall.nft", "keys"}
"""What stands beside the files of a mission on a board."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy units`."""
    parser.add_argument("mission", help="mission file")
    parser.add_argument("--board", help="which board it is for (default: the only one)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write, which must be new")
    parser.add_argument("--one-process", action="store_true", help="one daemon, `argosy board`, instead of three")
    text = f"where Argosy is installed on the board (default: {VENV})"
    parser.add_argument("--venv", type=_venv, default=VENV, metavar="DIR", help=text)


def run(args: Namespace) -> int:
    """Write the tree. Returns 0, 2 if the mission cannot be run so, 1 if the folder cannot be written."""
    try:
        mission = load_mission(args.mission)
        board = Board(mission, chosen(mission, args.board), args.venv, args.one_process)
        written = write(board, args.out)
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT
    except FileExistsError:
        print(f"error: {args.out} is not empty: what an older mission needed must not stay there", file=sys.stderr)
        return EXIT_BAD_INPUT
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror or error}", file=sys.stderr)
        return EXIT_FAILED
    for finding in check_mission(args.mission, restarts=True)[1]:
        if finding.kind == AFTER_RESTART:  # systemd starts every daemon again
            print(finding, file=sys.stderr)
    units = ", ".join((board.target, *board.units))
    print(f"{args.out}: {written} files for board {board.name}: {units}\nwhat to do with them: {args.out / GUIDE}")
    return EXIT_DONE


def write(board: Board, out: Path) -> int:
    """Write all files of a board; nothing is written if one cannot be made. Returns how many they are.

    Raises Findings, FileExistsError for a folder that has something in it, and OSError.
    """
    check(board.mission)
    secrets = secrets_of(board.mission, board.name)
    _check_secrets(board.mission, secrets)
    texts: dict[str, str | bytes] = dict(unit_files(board) | firewall_files(board))
    keys = None if board.keys is None else Path(board.keys)
    settings = config.router_settings(board.mission, board.name, socket=board.socket, keys=keys)
    texts[f"{board.folder[1:]}/router.json5"] = config.write(settings)
    for name, path in files_of(board.mission, board.name).items():
        if Path(name).parts[0] in TAKEN:
            raise Findings([Finding(str(path), 0, 0, "a board has another file of this name: rename the mission's")])
        texts[f"{board.folder[1:]}/{name}"] = path.read_bytes()
    texts[GUIDE] = guide(board, secrets)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError
    for name, text in texts.items():
        target = out / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text if isinstance(text, bytes) else text.encode())
        target.chmod(0o644)
        for folder in target.relative_to(out).parents:  # daemons of other users read them, whatever our umask is
            (out / folder).chmod(0o755)
    return len(texts)


def check(mission: Mission) -> None:
    """Raise Findings for a mission whose boards are not run by units."""
    if mission.router.external:
        text = "router.external: the units run commd as the board's router; leave it out"
        raise Findings([mission.positions.finding(("router", "external"), text)])
    name = mission.path.name
    if not name.isprintable() or name != name.strip() or set(name) & set("\"'\\`$%#;"):
        text = "expected a file name without quotes, control characters and ` \\ $ % # ;: units name it"
        raise Findings([Finding(str(mission.path), 0, 0, text)])


def _check_secrets(mission: Mission, secrets: Sequence[str]) -> None:
    for name in secrets:
        if not name.isprintable():
            text = f"expected the name of a file without control characters, got {name!r}"
            where = next(
                robot for robot, its in mission.robots.items() if its.signing and its.signing.passphrase_file == name
            )
            raise Findings([mission.positions.finding(("robots", where, "signing", "passphrase_file"), text)])


def _venv(text: str) -> str:
    if not re.fullmatch(r"/[A-Za-z0-9_./+-]+", text) or ".." in text.split("/"):
        raise ArgumentTypeError(f"expected an absolute path without blanks and `..`, got `{text}`")
    if text.startswith(("/home/", "/root/", "/run/user/", "/tmp/", "/var/tmp/")):  # noqa: S108  to refuse them
        raise ArgumentTypeError(f"the daemons do not see {text}: install below /opt, /usr or /srv")
    return text.rstrip("/")
