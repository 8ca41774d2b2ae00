"""`argosy manifest convert`: the paper's pair of INI manifests as one TOML manifest, which does the same."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bridged.drivers import check_manifest
from bridged.paper_format.ini_manifests import load_ini_pair
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.files.findings import Findings
from schemas.manifest.text import write_toml

HEADER = """\
# Converted from {actions} and {percepts}.
# `values = "text"` keeps the paper's text semantics (docs/reference/manifests.md); without it true stays true.

"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy manifest convert`."""
    parser.add_argument("actions", type=Path, metavar="ACTIONS", help="the paper's actions manifest")
    parser.add_argument("percepts", type=Path, metavar="PERCEPTIONS", help="the paper's perceptions manifest")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="new file to write (default: stdout)")


def run(args: Namespace) -> int:
    """Convert a pair. Returns 2, with every problem told, if it cannot be read or the file is there already."""
    try:
        manifest = load_ini_pair(args.actions, args.percepts)
        if wrong := check_manifest(manifest):
            raise Findings(wrong)
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT
    text = HEADER.format(actions=args.actions.name, percepts=args.percepts.name) + write_toml(manifest)
    if args.output is None:
        print(text, end="")
        return EXIT_DONE
    try:
        with args.output.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        print(f"error: {args.output}: {error.strerror}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(f"{args.output}: {len(manifest.percepts)} percepts, {len(manifest.actions)} actions")
    return EXIT_DONE
