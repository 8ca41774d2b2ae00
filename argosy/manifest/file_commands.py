"""`argosy manifest check`, `schema` and `convert`: manifests in files."""

from __future__ import annotations

import re
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from argosy.cli.errors import BadInput, CommandError
from bridged.drivers.registry import check_manifest, load_robot_manifest
from bridged.paper_format.ini_manifests import load_ini_pair
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from commd.process.state_dir import write_output
from schemas.files.findings import Finding, Findings
from schemas.files.text_files import read_text
from schemas.manifest.document import write_toml
from schemas.manifest.json_schema import schema_text
from schemas.manifest.loader import TABLES, Manifest

_SECTION = re.compile(r"^\[+([^\[\]]*)\]", re.MULTILINE)


def add_check_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest check`."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="manifests: TOML files, names of shipped ones, or the paper's two INI files: ACTIONS,PERCEPTS",
    )


def add_schema_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest schema`: none."""


def schema(args: Namespace) -> int:
    """Print the JSON Schema."""
    print(schema_text(), end="")
    return EXIT_DONE


def check(args: Namespace) -> int:
    """Read manifests and print what is wrong with all of them. Returns 2 if anything is."""
    findings: list[Finding] = []
    for named in _manifests(args.files):
        try:
            manifest = _load(named)
        except Findings as found:
            findings += found.findings
            continue
        percepts, actions = len(manifest.percepts), len(manifest.actions)
        print(f"{','.join(named)}: ok: {manifest.robot.driver}, {percepts} percepts, {actions} actions", flush=True)
    for finding in findings:
        print(finding, file=sys.stderr)
    return EXIT_BAD_INPUT if findings else EXIT_DONE


def _manifests(given: list[str]) -> list[tuple[str, ...]]:
    """Return what belongs together: `ACTIONS,PERCEPTS` written so, or two INI files one after the other."""
    found: list[tuple[str, ...]] = []
    waiting = False
    for name in given:
        parts = tuple(part.strip() for part in name.split(","))
        ini = len(parts) == 1 and is_ini(Path(name))
        if ini and waiting:
            found[-1] += parts
        else:
            found.append(parts)
        waiting = ini and not waiting
    return found


def _load(named: tuple[str, ...]) -> Manifest:
    """Read one manifest and let its drivers look at it. Raises Findings."""
    if len(named) == 1 and is_ini(Path(named[0])):
        problem = "this is one of the paper's two INI files: name both, ACTIONS,PERCEPTS"
        raise Findings.about(named[0], problem)
    manifest = load_robot_manifest(named[0] if len(named) == 1 else named, Path())
    if findings := check_manifest(manifest):
        raise Findings(findings)
    return manifest


def is_ini(path: Path) -> bool:
    """Whether a file has the sections of an INI manifest: any but those of a TOML one."""
    try:
        sections = _SECTION.findall(read_text(path))
    except Findings:
        return False
    return bool(sections) and not any(one.partition(".")[0].strip() in TABLES for one in sections)


HEADER = """\
# Converted from {actions} and {percepts}.
# `values = "text"` keeps the paper's text semantics (docs/reference/manifests.md); without it true stays true.

"""


def add_convert_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest convert`."""
    parser.add_argument("actions", type=Path, metavar="ACTIONS", help="the paper's actions manifest")
    parser.add_argument("percepts", type=Path, metavar="PERCEPTIONS", help="the paper's perceptions manifest")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="new file to write (default: stdout)")


def convert(args: Namespace) -> int:
    """Convert a pair. Raises Findings with every problem of the pair, BadInput if the file exists, and CommandError."""
    manifest = load_ini_pair(args.actions, args.percepts)
    if wrong := check_manifest(manifest):
        raise Findings(wrong)
    text = HEADER.format(actions=args.actions.name, percepts=args.percepts.name) + write_toml(manifest)
    if args.output is None:
        print(text, end="")
        return EXIT_DONE
    if args.output.exists():
        raise BadInput(f"{args.output} exists: name another file")
    try:
        write_output(args.output, text.encode())
    except OSError as error:
        raise CommandError(f"{args.output}: {error.strerror}") from None
    print(f"{args.output}: {len(manifest.percepts)} percepts, {len(manifest.actions)} actions")
    return EXIT_DONE
