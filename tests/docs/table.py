"""What of the pages is not done as it stands, each with its reason. An entry that matches nothing fails a test.

A key is a page and how a command, or the text of a block, begins. Forms of commands (`argosy run MISSION`) need no
entry: that they parse is checked, and nothing else can be.
"""

from typing import Final, NamedTuple, TypeVar

Key = tuple[str, str]
Entry = TypeVar("Entry")

_NETWORK = "installs from a package index"
_REAL = "a real vehicle"
_BOARD = "on a board: tests/argosy/deploy/test_units_command.py, docs/measurements/daemons.md"

NOT_RUN: Final[dict[Key, str]] = {
    ("CONTRIBUTING.md", "make "): "is what runs this",
    ("CONTRIBUTING.md", ".ci/run"): "is what runs this",
    ("CONTRIBUTING.md", ".venv/bin/python -m pytest"): "is what runs this",
    ("README.md", "make fly"): "makes a virtual environment from a package index, then `argosy run`",
    ("README.md", "make test"): "is what runs this",
    (
        "docs/measurements/benchmarks.md",
        "make bench",
    ): "90 minutes: tests/benchmarks/test_command.py tries it with parts of its own",
    ("docs/guides/drivers.md", "pip install"): _NETWORK,
    ("docs/guides/drivers.md", "argosy check counting.yaml"): "tests/argosy/test_robots.py, with the package installed",
    ("docs/guides/drivers.md", "argosy run counting.yaml"): "tests/argosy/test_robots.py, with the package installed",
    (
        "docs/guides/drivers.md",
        "argosy check examples/lamp",
    ): "tests/bridged/drivers/test_example_drivers.py, with the package installed",
    (
        "docs/guides/drivers.md",
        "argosy run examples/lamp",
    ): "tests/bridged/drivers/test_example_drivers.py, with the package installed",
    ("docs/guides/boards.md", "sudo "): _BOARD,
    ("docs/guides/security.md", "sudo "): _BOARD,
    ("docs/guides/boards.md", "systemctl "): _BOARD,
    ("docs/guides/boards.md", "journalctl "): _BOARD,
    ("docs/start/install.md", "pip wheel"): "wants the checkout and a package index: tests/test_wheel.py",
    ("docs/start/install.md", "python3 -m venv /opt"): "another folder in tests/test_wheel.py",
    ("docs/start/install.md", "/opt/argosy/bin/"): "another folder in tests/test_wheel.py",
    ("docs/start/install.md", "argosy wheelhouse"): _NETWORK + ": tests/test_wheel.py",
    ("docs/start/install.md", "scp "): "a real board",
    ("docs/start/install.md", "ssh "): "a real board",
    ("docs/start/install.md", "sudo "): "a real board: the same without sudo in tests/test_wheel.py",
    ("docs/start/search-and-rescue.md", "argosy trial"): "minutes: tests/argosy/trial/test_trial_command.py",
    ("docs/start/search-and-rescue.md", "make rescue"): "minutes: tests/boards/test_rescue.py",
    ("docs/start/search-and-rescue.md", "argosy run"): "minutes: tests/boards/test_rescue.py",
    ("docs/start/search-and-rescue.md", "argosy referee"): "judges a flight of minutes: tests/boards/test_rescue.py",
    ("docs/guides/simulation.md", "mavproxy.py"): "wants a terminal: tests/bridged/clients",
    ("docs/guides/mavlink.md", "sim_vehicle.py"): "ArduPilot's simulator is no dependency",
    ("docs/guides/mavlink.md", "argosy run --real"): _REAL,
    ("docs/guides/mavlink.md", "sudo usermod"): "changes the machine",
    ("docs/guides/from-jason.md", "argosy run missions/paper_uav.yaml"): "tests/argosy/trial/test_missions.py",
    (
        "docs/guides/from-jason.md",
        "argosy run missions/paper_turtle.yaml",
    ): "tests/bridged/simulation/turtle/test_turtle.py",
    ("docs/guides/writing-programs.md", "mkdir -p ~/.vscode"): "the folder of an editor",
    (
        "docs/guides/writing-programs.md",
        "cp -r deploy/editor",
    ): "the folder of an editor; what is in it: tests/agentd/editor/test_lexers.py",
    ("docs/measurements/reasoner.md", "make bench"): "minutes, and it writes the page: tests/benchmarks",
    ("docs/measurements/reasoner.md", "python -m benchmarks.reasoner"): "minutes: tests/benchmarks",
    ("docs/guides/monitoring.md", ".venv/bin/pip install"): _NETWORK,
    ("docs/guides/monitoring.md", "argosy watch"): "wants a terminal: tests/argosy/watch/test_terminal.py",
    ("docs/guides/why.md", "argosy why"): "asks a running fleet: tests/argosy/why",
    ("docs/guides/boards.md", "argosy run"): "minutes: tests/boards/test_rescue.py",
    ("docs/guides/boards.md", "argosy wheelhouse"): "downloads: tests/test_wheel.py",
    ("docs/guides/boards.md", "scp"): _BOARD,
    ("docs/guides/operations.md", "sudo systemctl"): _BOARD,
    ("docs/guides/operations.md", "systemctl"): _BOARD,
    ("docs/start/tutorial.md", "sudo apt install"): _NETWORK,
    ("docs/start/tutorial.md", "make fly"): "makes a virtual environment from a package index, then `argosy run`",
    ("docs/start/tutorial.md", ". .venv/bin/activate"): "the tests have their own virtual environment",
}
"""Commands that are not run here: the reason. They have to parse all the same."""

_ON_THE_GROUND = """\
echo "+!never <- +mission_done; +mission_failed(no)." > idle.asl
 sed s,single_uav/uav.asl,../idle.asl, missions/single_uav.yaml > missions/idle.yaml
argosy run missions/idle.yaml"""
"""The first mission with an agent that wants nothing: it does not end."""

_INSTALLED = """\
mkdir -p site/sprayer-1.dist-info && cp examples/sprayer/*.py site
cat > site/sprayer-1.dist-info/METADATA <<END
Name: sprayer
Version: 1
END
cat > site/sprayer-1.dist-info/entry_points.txt <<END
[argosy.python]
sprayer = sprayer_functions
[argosy.python.simulated]
sprayer = sprayer_twin
END
export PYTHONPATH=$PWD/site"""
"""What an installer would leave of examples/sprayer, on the path."""

INSTEAD: Final[dict[Key, str]] = {
    ("docs/reference/bus-keys.md", "argosy run missions/single_uav.yaml"): _ON_THE_GROUND,
    ("docs/reference/manifests.md", "argosy run missions/single_uav.yaml"): _ON_THE_GROUND,
    ("docs/guides/my-robot.md", "pip install"): _INSTALLED,
    ("docs/guides/my-robot.md", "argosy run examples/sprayer"): (
        "argosy run examples/sprayer/sprayer.yaml --plain --speed 20"
    ),
    (
        "docs/start/tutorial.md",
        "argosy run missions/single_uav.yaml",
    ): "argosy run missions/single_uav.yaml --speed 3 --plain",
    ("docs/start/tutorial.md", "argosy run my/mission.yaml --plain --report"): (
        "argosy run my/mission.yaml --plain --speed 20 --report my/report"
    ),
    (
        "docs/start/tutorial.md",
        "argosy run my/mission.yaml --plain --speed 2",
    ): "argosy run my/mission.yaml --plain --speed 8",
    ("docs/start/tutorial.md", "argosy run my/mission.yaml --plain"): "argosy run my/mission.yaml --plain --speed 20",
}
"""Commands that take minutes: what is run in their place, the same at another speed."""


def entry(table: dict[Key, Entry], page: str, text: str) -> Entry | None:
    """What a table says of a command or block."""
    return next(
        (printed for (where, begin), printed in table.items() if where == page and text.startswith(begin)), None
    )


class Stay(NamedTuple):
    """A command that stays up, in a terminal of its own, while the commands after it run."""

    says: str
    """What it says when it is up; the next command runs then."""
    ends: str = "interrupt"
    """`interrupt`: ctrl-C; `itself`: it ends while the page is followed, with exit code 0; `failed`: with 1."""
    after: str = ""
    """How the command begins after which it is ended or has to end; none: at the end of the page."""


STAYS: Final[dict[Key, Stay]] = {
    ("docs/guides/drivers.md", "python room.py"): Stay(says=""),
    ("docs/guides/mail.md", "argosy run examples/client/survey.yaml"): Stay(says="agentd scout: up", ends="itself"),
    ("docs/reference/bus-keys.md", "argosy run missions/single_uav.yaml"): Stay(says="agentd uav: up"),
    ("docs/reference/bus-keys.md", "zenoh "): Stay(says='"daemon": "agentd"'),
    ("docs/guides/command-line-tools.md", "argosy run by-hand.yaml"): Stay(says="agentd uav: up", ends="itself"),
    ("docs/guides/command-line-tools.md", "zenoh --mode client --config look.json5 subscribe"): Stay(
        says="argosy/by-hand/local/health/agentd {"
    ),
    ("docs/reference/manifests.md", "argosy run missions/single_uav.yaml"): Stay(says="agentd uav: up"),
    ("docs/guides/simulation.md", "bridged simulate copter"): Stay(says="copter"),
    ("docs/guides/my-robot.md", "python examples/sprayer/tank.py"): Stay(says="waits"),
    ("docs/start/tutorial.md", "argosy run missions"): Stay(
        says="uav: flying to", ends="failed", after="argosy stop rtl"
    ),
    ("docs/start/tutorial.md", "python my/weather.py"): Stay(
        says="waits", after="argosy run my/mission.yaml --plain --speed 2"
    ),
}

NOT_WELL_FORMED: Final[dict[Key, str]] = {
    ("docs/reference/errors.md", '!start.\n+!start <- .print("hello")\n'): "wrong on purpose: test_errors_page.py",
    ("docs/reference/errors.md", "!start.\n+!start\n  <- .send(bob"): "wrong on purpose: test_errors_page.py",
    ("docs/reference/errors.md", "+!buy(X)"): "wrong on purpose: test_errors_page.py",
    ("docs/reference/errors.md", '!start.\n+!start <- .print("hello)'): "wrong on purpose: test_errors_page.py",
}
"""Blocks of `asl`, `python`, `toml`, ... that no parser of ours takes: the reason."""

NOT_COMMANDS: Final[dict[Key, str]] = {
    ("docs/guides/boards.md", "agentd has failed"): "what a board says",
    ("docs/guides/boards.md", "commd pi1"): "what `argosy run` calls this process",
    ("docs/guides/boards.md", "bridged pi1 uav1"): "what `argosy run` calls this process",
    ("docs/guides/boards.md", "agentd pi1"): "what `argosy run` calls this process",
    ("docs/guides/boards.md", "agentd pi2 was killed by SIGKILL"): "what `argosy run` says",
}
"""Code within sentences that begins with a program's name and is no command."""
