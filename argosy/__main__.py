"""The `argosy` command."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import NoReturn

from argosy.cli.extras import EXTRAS, install_command
from commd.process.command_line import Help, check_command
from schemas.humanize import escape_line

EXIT_FAILED, EXIT_BAD_USAGE, EXIT_INTERRUPTED = 1, 2, 130
LETTING_GO = 2.5
"""Wall seconds that sessions have to open or to close when nobody wants them any more."""
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
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()  # what is lost was no success
        return code
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # `argosy ... | head`: whoever reads has seen enough
        return 0
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        if package not in EXTRAS:
            raise
        print(f"error: argosy needs {package}: {install_command(EXTRAS[package])}", file=sys.stderr)
        return EXIT_BAD_USAGE
    except Exception as error:
        if os.environ.get("ARGOSY_DEBUG"):
            raise
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            print(f"error: argosy: {error.strerror}: {error.filename or 'what it prints is lost'}", file=sys.stderr)
            return EXIT_FAILED
        what = escape_line(f"{type(error).__name__}: {error}")
        print(f"error: argosy: defect in argosy: {what}; ARGOSY_DEBUG=1 shows where", file=sys.stderr)
        return EXIT_FAILED
    finally:
        _leave_no_broken_pipe()


def command() -> NoReturn:
    """Run the command line as a process, to its end."""
    _prepare_streams()
    code = main()
    if (process := sys.modules.get("commd.process.process")) is not None:  # it may have been on the bus
        process.end_with_threads(code, LETTING_GO)
    sys.exit(code)


def _prepare_streams() -> None:
    """Let what is printed neither fail for a terminal that knows ASCII alone nor for a stream that was closed."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - for the whole process
        getattr(sys, name).reconfigure(errors="backslashreplace")


def _run(given: list[str]) -> int:
    if given[:1] == ["manifest"]:  # it has commands of its own
        from argosy.manifest.command import main as manifest

        return manifest(given[1:])
    if given[:1] == ["keys"]:
        from argosy.keys.command import main as keys

        return keys(given[1:])
    if given and given[0] in COMMANDS:  # only what is asked for is imported
        name, text = given[0], COMMANDS[given[0]]
        about = f"{text[0].upper()}{text[1:]}."
        command = argparse.ArgumentParser(prog=f"argosy {name}", description=about, formatter_class=Help)
        add_arguments, run = _load(name)
        add_arguments(command)
        return run(command.parse_intermixed_args(given[1:]))  # options may stand anywhere: an emergency has no order
    from importlib.metadata import version  # daemons do without: it is larger than some of them

    parser = argparse.ArgumentParser(
        prog="argosy",
        description="Runs, checks and stops missions: teams of robots with BDI agents.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"argosy {version('argosy')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, text in COMMANDS.items():
        commands.add_parser(name, help=text)
    check_command(parser, given, COMMANDS)
    parser.parse_args(given)
    return parser.error("expected the COMMAND first")


def _leave_no_broken_pipe() -> None:
    """Flush now, while it can be caught: `argosy ... | head` is no error, nor is a terminal that was closed."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


COMMANDS = {
    "run": "run a mission on this machine: start its processes, watch them, end them",
    "board": "run commd, bridged and agentd of one board in one process, for boards with little memory",
    "simulate": "be the simulated robots of a mission that belong to this machine; for fleets of several machines",
    "check": "read everything that a mission names and tell what is wrong; start nothing",
    "manifest": "check, convert and print manifests of robots; change the one that a robot runs by",
    "status": "show the daemons of a fleet: who is there, how they are, who is missing",
    "keys": "make, renew and revoke the certificates by which boards and operators know each other",
    "doctor": "look a fleet over: clocks, disks, links, versions, percepts; say what to do",
    "record": "record everything that a fleet says into an MCAP file",
    "replay": "say a recording once more on the bus, tell what it holds, or live a mind of it again",
    "metrics": "serve the health of a fleet to Prometheus, on loopback",
    "why": "tell why an agent did, or did not do, something, back to what caused it",
    "watch": "look at a running fleet in the terminal: agents, minds, vehicles, mail, what happens",
    "mail": "show what waits in the mailboxes of a fleet, and what was given up",
    "plot": "draw a recording for a paper: tracks, altitude, modes, actions and messages on one axis of time",
    "referee": "judge a search and rescue by the simulators' logs or a recording: each victim one buoy",
    "wheelhouse": "download all that boards without internet install, Argosy's own wheel among it",
    "units": "write the systemd units, router configuration and files that one board of a mission needs",
    "echo": "show what is said on the bus, one line each",
    "hz": "measure how often something is said on each key, and how much it is",
    "list": "list who is on the bus, what each serves and what is said",
    "act": "let the robot of an agent act by hand, where the mission allows it",
    "ui": "serve a web page for this machine: map, minds, timeline, mail and stop buttons of a running fleet",
    "stop": "order robots to hold, land or return to launch, above every agent",
}


MODULES = {
    "act": "tools.act",
    "board": "deploy.board_command",
    "echo": "tools.echo",
    "hz": "tools.rate",
    "list": "tools.list",
    "metrics": "status.metrics_command",
    "plot": "plot.command",
    "record": "recording.record_command",
    "referee": "simulate.referee",
    "replay": "recording.replay_command",
    "units": "deploy.units_command",
    "wheelhouse": "deploy.wheelhouse_command",
}
"""The modules of commands; the others are the `command` in a folder of their name."""


def _load(name: str) -> tuple[Callable[[argparse.ArgumentParser], None], Callable[[argparse.Namespace], int]]:
    """Return what declares the arguments of a command, and what runs it; only its own module is imported."""
    module = import_module(f"argosy.{MODULES.get(name, f'{name}.command')}")
    return module.add_arguments, module.run


if __name__ == "__main__":
    command()
