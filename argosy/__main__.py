"""The `argosy` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

EPILOG = """\
examples:
  argosy check missions/single_uav.yaml            is everything right with it?
  argosy run missions/single_uav.yaml              fly it in simulation
  argosy run missions/single_uav.yaml --real uav1  fly the real vehicle
  argosy stop rtl                                  bring every robot home, from another terminal

exit codes: 0 done, 1 failed, 2 bad input, 130 ctrl-C
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="argosy",
        description="Runs, checks and stops missions: teams of robots with BDI agents.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    chosen: dict[str, Callable[[argparse.Namespace], int]] = {}
    given = list(sys.argv[1:] if argv is None else argv)
    for name, text in COMMANDS.items():
        command = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        if name in given:  # only what is asked for is imported
            add_arguments, chosen[name] = _load(name)
            add_arguments(command)
    args = parser.parse_args(given)
    try:
        return chosen[args.command](args)
    except KeyboardInterrupt:
        return 130
    finally:
        with suppress(BrokenPipeError):
            sys.stdout.flush()


COMMANDS = {
    "run": "run a mission on this machine: start its processes, watch them, end them",
    "check": "read everything that a mission names and tell what is wrong; start nothing",
    "stop": "order robots to hold, land or return to launch, above every agent",
}


def _load(name: str) -> tuple[Callable[[argparse.ArgumentParser], None], Callable[[argparse.Namespace], int]]:
    try:
        match name:
            case "run":
                from argosy import run

                return run.add_arguments, run.run
            case "check":
                from argosy import check

                return check.add_arguments, check.run
            case _:
                from argosy import stop

                return stop.add_arguments, stop.run
    except ModuleNotFoundError as error:
        if error.name in ("rich", "psutil"):
            sys.exit(f"error: argosy {name} needs {error.name}: pip install 'argosy[operator]'")
        raise


if __name__ == "__main__":
    code = main()
    with suppress(BrokenPipeError, ValueError):
        sys.stdout.flush()
    sys.exit(code)
