"""The `argosy` command."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from argosy.cli.arguments import expect_command, run_command
from argosy.cli.errors import BadInput, CommandError, complain
from argosy.cli.extras import EXTRAS, install_command
from schemas.files.findings import Findings
from schemas.files.text_files import MAY_PASS
from schemas.humanize import escape_line

EXIT_FAILED, EXIT_BAD_USAGE, EXIT_INTERRUPTED = 1, 2, 130
LETTING_GO = 2.5
"""Wall seconds for sessions to finish opening or closing at exit."""
EPILOG = """\
examples:
  argosy check missions/single_uav.yaml            check the mission and all its files
  argosy run missions/single_uav.yaml              fly it in simulation
  argosy run missions/single_uav.yaml --real uav1  fly the real vehicle
  argosy stop rtl                                  return every robot to launch, from another terminal

exit codes: 0 done, 1 failed, 2 bad input, 130 ctrl-C
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit code."""
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()  # a failure to write is no success
        return code
    except Findings as findings:
        print(findings, file=sys.stderr)
        return BadInput.code
    except CommandError as error:
        complain(f"error: {error}")
        return error.code
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # `argosy ... | head`
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
        if isinstance(error, OSError) and error.errno in MAY_PASS:
            print(f"error: argosy: {error.strerror}: {error.filename or 'its output is lost'}", file=sys.stderr)
            return EXIT_FAILED
        what = escape_line(f"{type(error).__name__}: {error}")
        print(f"error: argosy: defect in argosy: {what}; ARGOSY_DEBUG=1 shows where", file=sys.stderr)
        return EXIT_FAILED
    finally:
        _leave_no_broken_pipe()


def command() -> NoReturn:
    """Run the command line as a process, to its end."""
    for name in ("stdout", "stderr"):  # printing is safe for an ASCII-only terminal and for closed streams
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - for the whole process
        getattr(sys, name).reconfigure(errors="backslashreplace")
    code = main()
    if (process := sys.modules.get("commd.process.process")) is not None:  # it has used the bus
        process.end_with_threads(code, LETTING_GO)
    sys.exit(code)


def _run(given: list[str]) -> int:
    if given and given[0] in COMMANDS:  # import only that one
        name, *rest = given
        module = import_module(f"argosy.{MODULES.get(name, f'{name}.command')}")
        if name not in GROUPS:
            return run_command("argosy", name, COMMANDS[name], (module.add_arguments, module.run), rest)
        if rest and rest[0] in module.COMMANDS:
            return run_command(f"argosy {name}", rest[0], module.COMMANDS[rest[0]], module.load(rest[0]), rest[1:])
        return expect_command(
            argparse.ArgumentParser(prog=f"argosy {name}", description=module.ABOUT), module.COMMANDS, rest
        )
    from importlib.metadata import version  # daemons do without it: it is large

    parser = argparse.ArgumentParser(
        prog="argosy",
        description="Run, check and stop missions: teams of robots with BDI agents.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"argosy {version('argosy')}")
    return expect_command(parser, COMMANDS, given)


def _leave_no_broken_pipe() -> None:
    """Flush now, while errors can be caught: a closed pipe or terminal is not an error."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


COMMANDS = {
    "run": (
        "run a mission on this machine: start its processes, show progress, stop them at the end",
        "missions/single_uav.yaml --speed 10",
    ),
    "board": (
        "run commd, bridged and agentd of one board in one process, for boards with little memory",
        "missions/search_and_rescue.yaml --board pi1",
    ),
    "simulate": (
        "run the simulated robots of a mission that belong to this machine, for fleets on several machines",
        "missions/search_and_rescue.yaml --board pi1",
    ),
    "trial": (
        "fly a mission many times in virtual time, with faults drawn by seed, and report the share of successes",
        "missions/single_uav.yaml --runs 100 --out report/trial",
    ),
    "check": (
        "check a mission and all files that it names, and print every mistake; start nothing",
        "missions/single_uav.yaml",
    ),
    "manifest": ("check, convert and print manifests of robots; read or change the one a running robot uses", ""),
    "plan": ("show a plan file of a ground station; save the mission that a vehicle stores as one", ""),
    "params": ("save, compare and load the parameters of a vehicle", ""),
    "status": ("show the daemons of a fleet: running, missing, and their health", "missions/single_uav.yaml --watch"),
    "keys": ("create, renew and revoke the certificates of a fleet's boards and operators", ""),
    "doctor": (
        "diagnose a running fleet: clocks, disks, links, versions, percepts; print what to do about each problem",
        "missions/three_uavs.yaml",
    ),
    "record": (
        "record everything that is published in a fleet to an MCAP file",
        "--mission missions/single_uav.yaml -o flight.mcap",
    ),
    "replay": (
        "publish a recording again, print what it holds, or verify that a recorded mind decides the same",
        "flight.mcap --info",
    ),
    "metrics": ("serve the health of a fleet to Prometheus, on this machine", "missions/search_and_rescue.yaml"),
    "why": ("explain why an agent did, or did not do, something, back to the first cause", "uav takeoff"),
    "watch": (
        "show a running fleet in the terminal: agents, minds, vehicles, mail, timeline",
        "--mission missions/three_uavs.yaml",
    ),
    "mail": ("show queued messages and dead letters of a fleet's mailboxes", "missions/search_and_rescue.yaml --dead"),
    "plot": (
        "plot a recording for a paper: tracks, altitude, modes, actions and messages over time",
        "flight.mcap -o flight.pdf",
    ),
    "referee": (
        "judge a search and rescue by simulator logs or a recording: each victim must get one buoy",
        "missions/search_and_rescue.yaml report/rescue",
    ),
    "wheelhouse": (
        "download all wheels that boards without internet need, with Argosy's own",
        "--platform aarch64 --out wheelhouse",
    ),
    "units": (
        "write the systemd units, router configuration and files that one board of a mission needs",
        "missions/search_and_rescue.yaml --board pi1 --out pi1",
    ),
    "echo": ("print messages on the bus, one line each", "uav1/percept/*"),
    "hz": ("measure rate, jitter and bandwidth of each key", "uav1 --once"),
    "list": ("list daemons on the bus, the queries they serve and the keys they publish", "--types"),
    "act": ("command one action of an agent's robot by hand, if the mission allows it", "uav takeoff 5"),
    "ui": (
        "serve a web page on this machine: map, minds, timeline, mail and stop buttons of a running fleet",
        "--port 8080 --browser",
    ),
    "stop": ("order robots to hold, land or return to launch, overriding every agent", "rtl uav1"),
}
"""Help of each command, and the arguments of an example."""

GROUPS = ("manifest", "keys", "params", "plan")
"""Commands with commands of their own: `ABOUT`, `COMMANDS` and `load` of their modules."""

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
"""Modules of commands; the others are `command` in the folder of their name."""


if __name__ == "__main__":
    command()
