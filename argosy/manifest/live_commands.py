"""`argosy manifest get` and `set`: read and change the manifest of a running bridge."""

from __future__ import annotations

import json
import math
import sys
import tomllib
from argparse import ArgumentParser, Namespace
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

from argosy.cli.errors import BadInput, CommandError
from argosy.cli.operator_bus import Unanswered, Where, add_fleet_arguments, fleet_of, on_the_bus
from commd.bus.bus import Bus
from commd.bus.errors import QueryFailed, QueryTimeout
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.files.toml_positions import key_parts
from schemas.humanize import escape_lines, printable
from schemas.manifest.document import BadPath, part_of, write_document, write_value
from schemas.wire import keys
from schemas.wire.codec import BadRecord
from schemas.wire.records import LiveManifest, ManifestChange

ANSWER_TIMEOUT = 5.0
"""Wall seconds for a bridge to answer, which it does without its robot."""


def _add_where(parser: ArgumentParser) -> None:
    parser.add_argument("robot", help="a running robot")
    add_fleet_arguments(parser, "the robot's fleet (default: whichever has the robot)")


def add_get_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest get`."""
    _add_where(parser)
    parser.add_argument("entry", nargs="?", help="only this part, such as percepts.altitude or percepts.altitude.rate")
    parser.add_argument("--toml", action="store_true", help="as TOML (default: JSON)")


def add_set_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest set`."""
    _add_where(parser)
    parser.add_argument(
        "changes",
        nargs="*",
        metavar="PATH=VALUE",
        help="a field or a whole entry, the value in TOML: percepts.altitude.rate=5, percepts.altitude.ttl='\"3s\"'",
    )
    parser.add_argument(
        "--remove", action="append", default=[], metavar="PATH", help="remove an entry or field; repeatable"
    )
    parser.add_argument("--version", type=int, metavar="N", help="refuse unless the manifest has this version")


def get_manifest(args: Namespace) -> int:
    """Print the running manifest of a robot."""

    async def ask(bus: Bus, fleet: str) -> int:
        return _show(await _asked(bus, fleet, args.robot, None), args.entry, args.toml)

    return _on_the_bus(args, ask)


def set_manifest(args: Namespace) -> int:
    """Change the running manifest of a robot. Returns 2 if the bridge refused the change, with all reasons."""
    values = dict(map(_assignment, args.changes))
    if not values and not args.remove:
        raise BadInput("expected what to change: PATH=VALUE or --remove PATH")
    change = ManifestChange(set=values, remove=tuple(args.remove), version=args.version)

    async def ask(bus: Bus, fleet: str) -> int:
        before = await _asked(bus, fleet, args.robot, None)
        answer = await _asked(bus, fleet, args.robot, change)
        for problem in answer.problems:
            print(printable(f"{args.robot}: {problem}"), file=sys.stderr)
        if answer.problems:
            print(f"{args.robot}: nothing was changed, version {answer.version}", file=sys.stderr)
            return EXIT_BAD_INPUT
        for text in taken_away(before.manifest, answer.manifest):
            print(printable(f"{args.robot}: warning: {text}"), file=sys.stderr)
        print(f"{args.robot}: version {answer.version} is in effect until its bridge ends")
        return EXIT_DONE

    return _on_the_bus(args, ask)


def taken_away(before: dict[str, Any], after: dict[str, Any]) -> Iterator[str]:
    """Yield what a program that flies by a manifest may miss in the changed one."""
    for kind in ("actions", "percepts"):
        if gone := sorted(before.get(kind, {}).keys() - after.get(kind, {}).keys()):
            yield f"programs that use them miss these {kind} from now on: {', '.join(gone)}"
    for name, entry in after.get("actions", {}).items():
        was, now = before.get("actions", {}).get(name, entry).get("deadline"), entry.get("deadline")
        if was != now:
            yield f"actions.{name}: the deadline is {now or 'the default'}, it was {was or 'the default'}"


def _assignment(text: str) -> tuple[str, Any]:
    """Read `PATH=VALUE`. Raises BadInput."""
    at = text.find("=")
    while at >= 0 and not key_parts(text[:at].strip()):
        at = text.find("=", at + 1)
    if at < 0:
        raise BadInput(f"expected PATH=VALUE such as percepts.altitude.rate=5, got `{text}`")
    path, value = text[:at].strip(), text[at + 1 :].strip()
    try:
        read = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        read = {}
    if list(read) != ["value"]:
        raise BadInput(f"{path}: `{value}` is no value in TOML; a text needs quotes: {path}='\"...\"'")
    if not _is_plain(read["value"]):
        raise BadInput(f"{path}: expected finite numbers, texts, lists and tables, got `{value}`")
    return path, read["value"]


def _is_plain(value: object) -> bool:
    """Whether a value reaches the bridge as it is: JSON has no infinity, and no times."""
    match value:
        case dict():
            return all(map(_is_plain, value.values()))
        case list():
            return all(map(_is_plain, value))
        case float():
            return math.isfinite(value)
    return isinstance(value, bool | int | str)


def _on_the_bus(args: Namespace, ask: Callable[[Bus, str], Awaitable[int]]) -> int:
    """Ask on the bus of the fleet that has the robot. Returns the exit code."""

    async def work(bus: Bus, where: Where) -> int:
        try:
            return await ask(bus, await fleet_of(bus, where, args.robot))
        except BadRecord as error:
            raise CommandError(str(error)) from None

    return on_the_bus(args, work)


async def _asked(bus: Bus, fleet: str, robot: str, change: ManifestChange | None) -> LiveManifest:
    """Return what the bridge of a robot answers. Raises Unanswered."""
    try:
        return await bus.ask_one(keys.manifest(fleet, robot), change, LiveManifest, ANSWER_TIMEOUT)
    except QueryTimeout:
        remedy = "; `argosy manifest get` shows whether the change is in effect" if change is not None else ""
        raise Unanswered(f"{robot}: its bridge did not answer within {ANSWER_TIMEOUT:g} s{remedy}") from None
    except QueryFailed as failed:
        raise Unanswered(f"{robot}: {failed}") from None


def _show(answer: LiveManifest, entry: str | None, toml: bool) -> int:
    """Print a manifest, or a part of it."""
    if entry is None:
        if toml:
            head = f"# {answer.robot}, version {answer.version} of its running manifest; read from {answer.file}"
            print(f"{printable(head)}\n\n{escape_lines(write_document(answer.manifest))}", end="")
        else:
            shown = {"version": answer.version, "file": answer.file, "manifest": answer.manifest}
            print(json.dumps(shown, indent=2))
        return EXIT_DONE
    try:
        steps, part = part_of(answer.manifest, entry)
    except BadPath as error:
        print(printable(f"{answer.robot}: {error}"), file=sys.stderr)
        return EXIT_BAD_INPUT
    if not toml:
        print(json.dumps(part, indent=2))
    elif len(steps) <= 2 and isinstance(part, dict):
        print(escape_lines(write_document({steps[0]: part if len(steps) == 1 else {steps[1]: part}})), end="")
    else:
        print(escape_lines(write_value(part)))
    return EXIT_DONE
