"""`argosy manifest check` and `schema`: manifests in files."""

from __future__ import annotations

import re
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bridged.bridge.manifest_loader import load_robot_manifest
from bridged.drivers import check_manifest
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.files.findings import Finding, Findings
from schemas.files.text_files import read_text
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
        said = "this is one of the paper's two INI files: name both, ACTIONS,PERCEPTS"
        raise Findings([Finding(named[0], 0, 0, said)])
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
