"""`argosy manifest check` and `schema`: manifests in files."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bridged.drivers import check_manifest
from bridged.manifests import load_robot_manifest
from commd.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.findings import Finding, Findings
from schemas.manifest import Manifest
from schemas.manifest_schema import schema_text


def add_check_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest check`."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="manifests: TOML files, names of shipped ones, or the paper's INI files as ACTIONS,PERCEPTS",
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
    for name in args.files:
        try:
            manifest = _load(name)
        except Findings as found:
            findings += found.findings
            continue
        percepts, actions = len(manifest.percepts), len(manifest.actions)
        print(f"{name}: ok: {manifest.robot.driver}, {percepts} percepts, {actions} actions", flush=True)
    for finding in findings:
        print(finding, file=sys.stderr)
    return EXIT_BAD_INPUT if findings else EXIT_DONE


def _load(name: str) -> Manifest:
    """Read one manifest and let its drivers look at it. Raises Findings."""
    pair = tuple(part.strip() for part in name.split(","))
    manifest = load_robot_manifest(name if len(pair) == 1 else pair, Path())
    if findings := check_manifest(manifest):
        raise Findings(findings)
    return manifest
