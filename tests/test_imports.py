"""What each daemon has imported once it serves: what the table says, over what its libraries import by themselves.

Seconds and megabytes follow from that, on every machine. A module that is not in the table is either to be imported
only where it is needed, or to be added here, with what it is for.
"""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import Final

import pytest

from argosy.processes.process_table import python_command
from benchmarks.processes import Watched, watched_command
from benchmarks.results import ROOT
from benchmarks.serving import SERVES, Site

COMMAND_LINE: Final = {"argparse", "gettext"}
MISSION: Final = {"copy", "dataclasses", "fnmatch", "ipaddress", "ntpath", "pathlib", "tomllib", "urllib", "yaml"}
"""To read the mission and manifests; `pathlib` brings most of them."""
THREADS: Final = {"concurrent", "queue", "resource"}
"""Work that may block, such as answers to slow readers, beside the loop; `resource` tells what the process uses."""
DIGESTS: Final = {"hashlib"}
CHECKSUMS: Final = {"zlib"}
"""Of what is kept on disk."""
KEPT: Final = {"sqlite3"}
"""Mail and minds on disk."""
LINK: Final = {"fastcrc", "hmac", "pymavlink", "termios", "tty"}
"""MAVLink, signed or not, over UDP or a serial line."""
REASONING: Final = {"bisect", "encodings", "random", "zlib"}
"""`zlib` packs the grammar's tables and what is told of a mind; a program may begin with a byte order mark."""

CALLBACKS: Final = {"_ctypes", "ctypes"}
"""Keeps the interpreter's state of Zenoh's threads."""
DAEMON: Final = COMMAND_LINE | MISSION | THREADS | CALLBACKS | {"gc"}
"""`gc` looks for garbage seldom, and not in what the start has made."""
ALLOWED: Final[dict[str, set[str]]] = {
    "client": MISSION | DIGESTS | CALLBACKS | {"commd", "concurrent", "queue", "schemas"},
    "commd": DAEMON | CHECKSUMS | DIGESTS | KEPT | {"commd", "schemas"},
    "bridged": DAEMON | CHECKSUMS | DIGESTS | LINK | {"bridged", "commd", "schemas"},
    "agentd": DAEMON | DIGESTS | KEPT | REASONING | {"agentd", "commd", "schemas"},
    "board": DAEMON | DIGESTS | KEPT | LINK | REASONING | {"agentd", "argosy", "bridged", "commd", "schemas"},
}
"""The packages and modules of each kind of process, by their first names."""
DIALECT: Final = {"pymavlink.dialects.v20.ardupilotmega"}
"""The only one of MAVLink's dialects that is loaded: each takes some MB."""
_BUS: Final = {"commd.bus", "commd.common", "commd.liveness", "commd.process", "schemas*"}
FOLDERS: Final[dict[str, set[str]]] = {
    "client": _BUS | {"commd.client", "commd.mail"},
    "commd": _BUS | {"commd", "commd.directory", "commd.mail", "commd.router"},
    "bridged": _BUS
    | {"bridged", "bridged.bridge", "bridged.drivers", "bridged.drivers.mavlink*", "bridged.paper_format"},
    "agentd": _BUS
    | {"agentd", "agentd.conversion", "agentd.extensions", "agentd.language*", "agentd.mail", "agentd.mind*"}
    | {"agentd.persistence", "agentd.runtime", "agentd.stdlib", "agentd.trace", "commd.client", "commd.mail"},
}
"""Our own folders that each kind of process loads modules from; those of `argosy board` are those of all three."""
ELSEWHERE: Final = {
    "agentd.check.command": "agentd check",
    "agentd.environment": "agentd run",
    "agentd.replay.replay": "argosy replay",
    "agentd.standalone.command": "agentd run",
    "agentd.replay.replayed_mind": "argosy replay",
    "agentd.standalone.standalone_team": "agentd run",
    "agentd.standalone.decision_printer": "argosy why",
    "agentd.standalone.environment_host": "agentd run",
    "bridged.paper_format.ini_manifests": "manifests in the paper's format",
    "commd.client.blocking": "programs without asyncio",
    "commd.gateway.gateway": "fleets of several networks",
    "commd.gateway.radio_model": "links by radio",
}
"""Modules in them that only other commands need, and which."""

_BELONGS: Final = {
    "_bisect": "bisect",
    "_blake2": "hashlib",
    "_hashlib": "hashlib",
    "_queue": "queue",
    "_random": "random",
    "_sha512": "random",
    "_sqlite3": "sqlite3",
    "cython_runtime": "yaml",
}
"""Modules behind others, which the interpreter may name differently."""
_SHOWS: Final = """
import json, os, runpy, signal, sys
def show(*_):  # it may come in the middle of a line that is being printed
    os.write(1, f"\\nIMPORTED {json.dumps(sorted(sys.modules))}\\n".encode())
signal.signal(signal.SIGUSR1, show)
what, *arguments = sys.argv[1:]
if what == "-m":
    sys.argv = arguments
    runpy.run_module(arguments[0], run_name="__main__", alter_sys=True)
else:
    sys.argv = ["-c", *arguments[1:]]
    exec(compile(arguments[0], "program", "exec"), {"__name__": "__main__"})
"""
_LIBRARIES: Final = "import asyncio, json, msgspec, runpy, signal, sys, zenoh\nprint(json.dumps(sorted(sys.modules)))"


@pytest.fixture(scope="module")
def libraries() -> set[str]:
    """What Python's event loop, Zenoh and msgspec import."""
    shown = subprocess.run(
        [sys.executable, "-P", "-c", _LIBRARIES], capture_output=True, text=True, check=True, timeout=60
    )
    return set(json.loads(shown.stdout))


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """What each kind of process has imported once it serves."""
    found: dict[str, set[str]] = {}
    for names in (("commd", "client", "bridged", "agentd"), ("board",)):
        site = Site.made(tmp_path_factory.mktemp("imports") / "site")
        with ExitStack() as stack:
            for name in names:
                found[name] = set(_shown(stack.enter_context(_showing(site, name))))
    return found


@contextmanager
def _showing(site: Site, name: str) -> Iterator[Watched]:
    """Run a process of a kind that tells at SIGUSR1 what it has imported."""
    command = site.command(name)
    begin = len(python_command()) - 1
    with watched_command(name, [*command[:begin], "-c", _SHOWS, *command[begin:]]) as found:
        found.wait_for(SERVES[name])
        yield found


def _shown(process: Watched) -> list[str]:
    process.process.send_signal(signal.SIGUSR1)
    process.wait_for("IMPORTED")
    (line,) = [line for _, line in process.output if line.startswith("IMPORTED")]
    return list(json.loads(line.partition(" ")[2]))


def _first(module: str) -> str:
    """The first name of a module; modules that belong to a public one are told by its name."""
    name = module.partition(".")[0]
    return "yaml" if name.startswith("_cython_") else _BELONGS.get(name, name)


@pytest.mark.parametrize("name", ALLOWED)
def test_a_process_that_serves_has_imported_what_the_table_says(
    name: str, imported: dict[str, set[str]], libraries: set[str]
) -> None:
    more = {_first(module) for module in imported[name] - libraries} - ALLOWED[name]
    assert not more, f"{name} imports {', '.join(sorted(more))}: import it where it is needed, or say here what for"


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="the table is that of one Python: others import less")
@pytest.mark.parametrize("name", ALLOWED)
def test_the_table_says_no_more_than_is_imported(name: str, imported: dict[str, set[str]], libraries: set[str]) -> None:
    """What is imported no longer is struck out, lest it comes back unseen."""
    less = ALLOWED[name] - {_first(module) for module in imported[name] - libraries}
    assert not less, f"{name} does without {', '.join(sorted(less))}: strike it out"


@pytest.mark.parametrize("name", ["bridged", "board"])
def test_one_dialect_of_mavlink_is_loaded(name: str, imported: dict[str, set[str]]) -> None:
    assert {one for one in imported[name] if one.startswith("pymavlink.dialects.v20.")} == DIALECT


@pytest.mark.parametrize("name", ALLOWED)
def test_modules_of_ours_come_from_the_folders_that_a_process_needs(name: str, imported: dict[str, set[str]]) -> None:
    folders = FOLDERS.get(name) or set().union(*FOLDERS.values(), {"argosy.cli", "argosy.deploy"})
    ours = {one for one in imported[name] if _first(one) in ("agentd", "argosy", "bridged", "commd", "schemas")}
    packages = {one for one in ours if any(other.startswith(f"{one}.") for other in ours)}
    strange = {one for one in ours - packages if not any(fnmatch(one.rpartition(".")[0], folder) for folder in folders)}
    assert not strange, f"{name} imports {', '.join(sorted(strange))}, from folders that it has nothing to do with"


@pytest.mark.parametrize("name", ALLOWED)
def test_what_only_other_commands_need_is_not_imported(name: str, imported: dict[str, set[str]]) -> None:
    wrong = {one: ELSEWHERE[one] for one in imported[name] & ELSEWHERE.keys()}
    assert not wrong, f"{name} imports {wrong}"


@pytest.mark.parametrize("module", ELSEWHERE)
def test_what_only_other_commands_need_is_there(module: str) -> None:
    path = Path(ROOT, *module.split("."))
    assert path.with_suffix(".py").is_file() or (path / "__init__.py").is_file(), f"{module} is no module any more"
