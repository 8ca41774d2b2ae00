"""Attacks by text that is shown, files that are named or left behind, values that grow, and what is no HTTP."""

import asyncio
import os
import re
import socket
import stat
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from tests.argosy.watch.hostile import RAW, saying
from tests.argosy.watch.terminal import Terminal
from tests.attacks.world import NAME, TEXT, Attack, Row, World, attack
from tests.support.processes import Daemon
from tests.support.secured import Secured

SHOWN = 60.0
"""Seconds that a command has to show what it shows, and to end."""
REFUSED = 20.0
"""Seconds in which a program that is no file is refused; most of it is the start of Python."""
SILENT = 600
"""Connections that a test may hold by the usual limit of open files."""
MALFORMED = (
    b"\x00\x01\x02\r\n\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nA\x1b[2J: \r\n\r\n",
    b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\nHost: x\r\n\r\n",
    b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n",
    b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"GET http://[::1 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil\r\n\r\n",
    b"GET /?token=%ff%00%zz HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: \xff=\xff\r\n\r\n",
)


@attack(
    "text that commands a terminal",
    "a member of pi3 publishes OSC titles, cursor moves, C1 codes, line breaks and marks of writing direction as mind, "
    "beliefs, mail, health notes, percepts and actions of `c` and `r3`; the operator looks by `argosy status`, "
    "`why`, `echo` and `watch`, each in a terminal",
    "`argosy`: text of others is escaped where it is shown",
)
async def commands_to_terminals(row: Row, world: World) -> None:
    """Say what a terminal takes for commands in every text of an agent's and a robot's records."""
    ops = ("--mission", str(world.fleet.path), "--keys", str(world.fleet.keys("ops")))
    looks = {
        "status": ["status", *ops[1:]],
        "why": ["why", "c", *ops],
        "echo": ["echo", "c", "--count", "10", *ops],
        "watch": ["watch", *ops],
    }
    with saying(world.fleet.socket("pi3"), "commands", NAME, "c", "r3"):
        outputs = await asyncio.gather(*(asyncio.to_thread(_output, arguments) for arguments in looks.values()))
        for command, output in zip(looks, outputs, strict=True):
            row.expect(b"PWNED" in output, f"`argosy {command}` shows what was said")
            passed = [sequence for sequence in RAW if sequence in output]
            row.expect(not passed, f"`argosy {command}` lets through {passed}")
            row.expect(b"Traceback" not in output and b"defect" not in output, f"`argosy {command}` goes on")
            if command == "why":
                found = re.search(rb"\]0;PWNED[^\r\n]{0,40}", output)
                row.seen.append(f"`argosy why c`: `{found[0].decode() if found else ''}`")
    row.seen.append(f"none of {len(RAW)} sequences in the output of {', '.join(looks)}")


def _output(arguments: list[str]) -> bytes:
    """What a command of `argosy` writes to a terminal until it ends, `watch` until it shows the mind."""
    with Terminal(["argosy", *arguments], columns=160, lines=60) as terminal:
        if arguments[0] == "watch":
            terminal.until(lambda text: "PWNED" in text, "what was said", SHOWN)
            terminal.press("q")
        terminal.end(SHOWN)
        return terminal.output


@attack(
    "state that everybody may read",
    "`commd`, `bridged` and `agentd` of a board started by hand under umask 0",
    "the daemons: folders 0700 and files 0600, whatever the umask",
)
async def state_under_an_open_umask(row: Row, _: World) -> None:
    """Start the daemons of a board by hand, in a shell whose umask is 0."""
    before = os.umask(0)
    try:
        fleet = Secured(TEXT)
        with fleet:
            await asyncio.to_thread(_serve, fleet)
            state = fleet.folder / "state"
            modes = {path: stat.S_IMODE(path.lstat().st_mode) for path in [state, *state.rglob("*")]}
    finally:
        os.umask(before)
    open_ones = [f"{path.relative_to(state.parent)} {mode:o}" for path, mode in modes.items() if mode & 0o077]
    row.expect(not open_ones, f"nobody else may read {open_ones}")
    kinds = {path.suffix or path.name for path in modes if not path.is_dir()}
    row.expect({".mail", ".minds", ".actions"} <= kinds, f"mail, minds and the ledger are among {kinds}")
    row.seen.append(f"{len(modes)} files and folders of state, none of which group or others may read or write")


def _serve(fleet: Secured) -> None:
    fleet.routers(("pi1",))
    fleet.run("argosy", "simulate", str(fleet.path), "--board", "pi1", "--router", fleet.socket("pi1")).says(
        "simulated turtle", 60
    )
    fleet.start("pi1", "bridged").says("serving r1")
    fleet.start("pi1", "agentd").says("agents=")


LEAVES = """
!go("/etc/passwd"). !go("../other.asl"). !go("link.asl"). !go("own.asl").
+!go(X) <- .include(X); .print("included ", X).
-!go(X)[error_msg(M)] <- .print("refused: ", M).
!save("../saved.asl"). !save("out/saved.asl"). !save("saved.asl").
+!save(X) <- .save_agent(X); .print("saved ", X).
-!save(X)[error_msg(M)] <- .print("refused: ", M).
"""


@attack(
    "files outside of the project",
    "`agentd run` of a program that includes `/etc/passwd`, `../other.asl` and a link there, and saves itself at "
    "`../saved.asl` and below a link to a folder",
    "`.include` and `.save_agent`: within the project's folders, links resolved; `--allow-folder` allows others",
)
async def files_outside(row: Row, world: World) -> None:
    """Run a program that reads and writes files outside of its folder, by paths and by links."""
    outside = world.fleet.folder / "files"
    project = outside / "project"
    project.mkdir(parents=True)
    (outside / "other.asl").write_text("other.\n")
    (project / "own.asl").write_text("own.\n")
    (project / "link.asl").symlink_to(outside / "other.asl")
    (project / "out").symlink_to(outside)
    (project / "leaves.asl").write_text(LEAVES)
    _, text = await asyncio.to_thread(_agentd_run, "leaves.asl", project)
    refused = [line.partition("refused: ")[2] for line in text.splitlines() if "refused: " in line]
    row.expect(len(refused) == 5, f"five are refused, not {refused}")
    row.expect("included own.asl" in text and "saved saved.asl" in text, "what is its own, it may")
    row.expect({path.name for path in outside.iterdir()} == {"project", "other.asl"}, "nothing was written elsewhere")
    row.seen += [f"`{text.replace(str(project), 'project')}`" for text in refused[:1]]
    row.seen.append(f"{len(refused)} refused; its own file included, and it saved there")


@attack(
    "values that double",
    "`agentd run` of a program that concatenates a text to itself without end, and then a list",
    "`.concat`: 16,000,000 characters or 1,000,000 members; beyond, the plan fails",
)
async def values_that_double(row: Row, world: World) -> None:
    """Let a program concatenate a text and a list to themselves without end."""
    folder = world.fleet.folder / "doubles"
    folder.mkdir()
    (folder / "doubles.asl").write_text(
        '!a("0123456789"). !a([0,1,2,3,4,5,6,7,8,9]).\n+!a(X) <- .concat(X, X, Y); !a(Y).\n'
        "-!a(_)[error(too_large),error_msg(M)] <- .print(M).\n"
    )
    code, text = await asyncio.to_thread(_agentd_run, "doubles.asl", folder)
    reported = [line for line in text.splitlines() if "concat" in line]
    row.expect(code == 0 and len(reported) == 2, f"two plans fail, not {text[-500:]}")
    row.expect("Traceback" not in text, "no traceback")
    row.seen += [f"`{line}`" for line in reported]


@attack(
    "a pipe or a device as a program",
    "`agentd run` and `argosy check` with a named pipe that nobody writes to, and with `/dev/zero`",
    "whoever reads: a program is a regular file of at most 16 MB",
)
async def programs_that_are_no_files(row: Row, world: World) -> None:
    """Name a named pipe and a device as programs, for `agentd run` and in a mission for `argosy check`."""
    folder = world.fleet.folder / "pipes"
    folder.mkdir()
    os.mkfifo(folder / "pipe.asl")
    (folder / "zero.asl").symlink_to("/dev/zero")
    for name in ("pipe.asl", "zero.asl"):
        mission = folder / f"{name}.yaml"
        mission.write_text(f"mission: m\nagents:\n  a: {{program: {name}}}\n")
        for command in (("agentd", "run", name), ("argosy", "check", mission.name)):
            code, text, seconds = await asyncio.to_thread(_ended, command, folder)
            row.expect(code == 2, f"{' '.join(command)} ends with 2, not {code}")
            row.expect(seconds < REFUSED, f"{' '.join(command)} ends within {REFUSED:g} s, not in {seconds:.1f} s")
            row.expect("Traceback" not in text and "defect" not in text, "it is told in a line")
            if command[0] == "agentd":
                line = text.replace(f"{folder}/", "").strip().splitlines()[0]
                row.seen.append(f"`{line}`")


@attack(
    "what is no HTTP",
    f"{len(MALFORMED)} malformed requests at the port of `argosy ui` of an operator: bytes, overlong lines, bad "
    "lengths, control characters in headers",
    "`argosy ui`: refused and counted, in one line for the 1st, 2nd, 4th, 8th",
)
async def malformed_http(row: Row, world: World) -> None:
    """Send what is no HTTP to the page of an operator."""
    async with _operators_page(world) as page:
        for sent in MALFORMED:
            answer = await asyncio.to_thread(_answer, page.port, sent)
            row.expect(not answer or re.match(rb"HTTP/1\.\d 4", answer), f"{sent[:20]!r} is refused: {answer[:60]!r}")
        answer = await page.answer()
        row.expect(answer.startswith(b"HTTP/1.1 303"), f"its operator is let in: {answer[:60]!r}")
        await asyncio.to_thread(page.process.says, "malformed requests so far")
        row.expect(not re.search(r"defect|Traceback|\x1b", page.process.text), page.process.text)
        counted = [line for line in page.process.lines if "malformed" in line]
        row.seen.append(f"`{counted[-1].removeprefix('argosy ui: ')}`")


@attack(
    "silent connections to the page",
    f"{SILENT} connections to `argosy ui` of an operator that say nothing, or half of a request; then the operator "
    "opens the page",
    "`argosy ui`: of more than 400 connections without the page's cookie the oldest is closed",
)
async def silent_connections(row: Row, world: World) -> None:
    """Hold connections to the page of an operator."""
    async with _operators_page(world) as page:
        with ExitStack() as held:
            silent = [held.enter_context(socket.create_connection(("127.0.0.1", page.port), 10)) for _ in range(SILENT)]
            for number, one in enumerate(silent):
                with suppress(OSError):  # it is closed already
                    one.send(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" if number % 2 else b"")
            began = time.monotonic()
            answer = await page.answer()
            seconds = time.monotonic() - began
            row.expect(answer.startswith(b"HTTP/1.1 303"), f"its operator is let in: {answer[:60]!r}")
            closed = sum(_is_closed(one) for one in silent)
            row.expect(closed, "the oldest were closed")
            row.expect(not re.search(r"defect|Traceback", page.process.text), page.process.text)
    row.seen.append(f"the operator has the page after {seconds:.1f} s; {closed} of {SILENT} silent connections closed")


@dataclass
class _Page:
    """An `argosy ui` that runs."""

    process: Daemon
    port: int
    token: str
    """The query of the address that it has printed."""

    async def answer(self) -> bytes:
        """Open it as its operator does; return the beginning of the answer."""
        request = f"GET /?{self.token} HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\n\r\n".encode()
        return await asyncio.to_thread(_answer, self.port, request, False)


@asynccontextmanager
async def _operators_page(world: World) -> AsyncIterator[_Page]:
    keys = ("--mission", str(world.fleet.path), "--keys", str(world.fleet.keys("ops")), "--port", "0")
    process = world.fleet.run("argosy", "ui", *keys)
    try:
        await asyncio.to_thread(process.says, "open http://", SHOWN)
        address = urlsplit(next(line for line in process.lines if line.startswith("open "))[5:])
        yield _Page(process, address.port or 0, address.query)
    finally:
        process.kill()


def _is_closed(link: socket.socket) -> bool:
    link.settimeout(0.0)
    try:
        return link.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


@attack(
    "a folder that another user has made first",
    "without XDG_RUNTIME_DIR, the folder in which runs leave their routers is there before, open to all, with links "
    "to a file of the user where `argosy run` writes",
    "`argosy run` and all commands: a folder that is not the user's alone is not used",
)
async def prepared_folder(row: Row, world: World) -> None:
    """Prepare the folder of a user's runs, with links."""
    around = world.fleet.folder / "tmp"
    folder = around / f"argosy-{os.getuid()}"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    mine = around / "mission.yaml"
    mine.write_text("mission: m\nagents:\n  a: {program: a.asl}\n")
    (around / "a.asl").write_text("!a. +!a <- .stopMAS.\n")
    for link in (*(f"{pid}.json" for pid in range(1, 5000)), "tcp_127_0_0_1_7447.starting"):
        (folder / link).symlink_to(mine)
    with _environment(XDG_RUNTIME_DIR=str(around)):
        _, text, _ = await asyncio.to_thread(_ended, ("argosy", "run", str(mine)), around)
    row.expect(mine.read_text().startswith("mission: m"), "the user's file is as it was")
    warned = [line for line in text.splitlines() if "must name the router" in line]
    row.expect(warned, f"it is warned of, not {text[-500:]}")
    row.seen += [f"`{line.replace(str(around), '/tmp')}`" for line in warned[:1]]


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _answer(port: int, sent: bytes, ends: bool = True) -> bytes:
    with socket.create_connection(("127.0.0.1", port), timeout=10) as link:
        link.sendall(sent)
        if ends:
            link.shutdown(socket.SHUT_WR)
        return link.recv(65_536)


def _agentd_run(program: str, folder: Path) -> tuple[int, str]:
    code, text, _ = _ended(("agentd", "run", program, "--exit-when-idle", "--timeout", "60"), folder)
    return code, text


def _ended(command: tuple[str, ...], folder: Path) -> tuple[int, str, float]:
    """Run a command in a folder to its end. Returns its exit code, what it said, and the seconds that it took."""
    began = time.monotonic()
    daemon = Daemon(*command, code=folder)
    try:
        return daemon.ends(90), daemon.text, time.monotonic() - began
    finally:
        daemon.kill()


TEXT_AND_FILES: tuple[Attack, ...] = (
    commands_to_terminals,
    state_under_an_open_umask,
    files_outside,
    values_that_double,
    programs_that_are_no_files,
    malformed_http,
    silent_connections,
    prepared_folder,
)
