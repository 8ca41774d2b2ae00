"""What others say, shown by every command in a real terminal: it commands no terminal, and no markup of it counts."""

import time
import xml.etree.ElementTree
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.argosy.watch.hostile import FLEET, RAW, saying
from tests.argosy.watch.terminal import Terminal
from tests.support import forked

MISSION = """
mission: hostile
boards: {pi1: {}}
agents:
  scout: {board: pi1, program: says.asl, robot: uav1}
robots:
  uav1: {board: pi1, manifest: turtle, prefix: r1, simulate: {vehicle: turtle}}
"""
COMMANDS: dict[str, tuple[str, ...]] = {
    "status": ("mission.yaml",),
    "doctor": ("mission.yaml",),
    "why": ("scout",),
    "mail": ("mission.yaml", "--dead"),
    "list": ("--types",),
    "echo": ("--count", "40"),
    "hz": ("--once",),
}
SAYS = """
believed(BAD).
!say(1).
+!say(N) : N < 200 <- .print(BAD, N); +said(BAD, N); .wait(100); !say(N + 1).
+!say(_) <- .print(end).
+!do(BAD).
"""


@pytest.fixture
def mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "says.asl").write_text("a.\n")
    (tmp_path / "mission.yaml").write_text(MISSION)
    return tmp_path / "mission.yaml"


@pytest.mark.parametrize("kind", ["commands", "markup"])
def test_no_command_lets_what_a_fleet_says_command_the_terminal(mission: Path, endpoint: str, kind: str) -> None:
    with saying(endpoint, kind), ExitStack() as stack:
        terminals = {
            command: stack.enter_context(
                Terminal(["argosy", command, *arguments, "--router", endpoint], columns=1000, lines=100)
            )
            for command, arguments in COMMANDS.items()
        }
        for command, terminal in terminals.items():
            terminal.end(90)
            output = terminal.output
            assert not [sequence for sequence in RAW if sequence in output], command
            assert b"\x1b]8;" not in output, f"{command}: a link"
            assert b"Traceback" not in output, command
            assert b"defect" not in output, command
            words = b"PWNED" if kind == "commands" else b"[bold red]rich["
            assert words in output or command in ("doctor", "hz"), (command, output)


@pytest.mark.parametrize("kind", ["commands", "markup"])
def test_what_a_fleet_said_is_text_in_recordings_and_figures(tmp_path: Path, endpoint: str, kind: str) -> None:
    file, figure = tmp_path / "a.mcap", tmp_path / "a.svg"
    with saying(endpoint, kind):
        _argosy("record", "--router", endpoint, "--max-time", "6s", "-o", str(file))
    info = _argosy("replay", str(file), "--info")
    assert not [sequence for sequence in RAW if sequence in info]
    _argosy("plot", str(file), "--fleet", FLEET, "-o", str(figure))
    _argosy("plot", str(file), "--fleet", FLEET, "--csv", str(tmp_path / "csv"))
    text = figure.read_bytes()
    tables = b"".join(table.read_bytes() for table in (tmp_path / "csv").iterdir())
    assert b"PWNED" in tables or kind == "markup"
    assert not [sequence for sequence in RAW if sequence in text + tables]
    elements = {element.tag.rpartition("}")[2] for element in xml.etree.ElementTree.fromstring(text).iter()}
    assert elements.isdisjoint({"script", "img", "a", "b", "image", "foreignObject", "iframe"}), elements
    assert b'href="java' not in text


def test_the_screen_of_a_run_shows_what_agent_and_robot_say_as_text(
    mission: Path, tmp_path: Path, endpoint: str
) -> None:
    bad = '"\x1b]0;PWNED\x07\x1b[5;5HPWNED\x9b2J\u202e\\r\\nFORGED"'
    (tmp_path / "says.asl").write_text(SAYS.replace("BAD", bad))
    report = tmp_path / "report"
    run = ["argosy", "run", str(mission), "--router", endpoint, "--report", str(report)]
    with Terminal(run, columns=200, lines=50) as terminal:
        terminal.shows("PWNED", 90)
        with saying(endpoint, "commands", "hostile", "scout", "uav1"):
            terminal.until(lambda text: "GUIDED" in text, "what is said in the robot's name is shown")
            until = time.monotonic() + 3
            terminal.until(lambda _: time.monotonic() > until, "a while")
        terminal.press("\x03")
        terminal.end(90)
        assert not [sequence for sequence in RAW if sequence in terminal.output]
        assert b"Traceback" not in terminal.output
    for file in ("mission.log", "summary.txt", "track.svg"):
        written = (report / file).read_bytes()
        assert not [sequence for sequence in RAW if sequence in written], file


@pytest.mark.parametrize("command", ["check", "run", "status", "doctor", "mail", "watch", "ui"])
def test_a_mission_whose_name_is_markup_or_commands_is_refused_in_words(mission: Path, command: str) -> None:
    mission.write_text(MISSION.replace("mission: hostile", 'mission: "<script>PWNED</script>\\e[5;5HPWNED\\n\\u202e"'))
    option = ("--mission",) if command in ("watch", "ui") else ()
    with Terminal(["argosy", command, *option, str(mission)], columns=1000) as terminal:
        assert terminal.end(60) == 2
    assert b"<script>PWNED</script>\\x1b[5;5HPWNED\\n\\u202e" in terminal.output
    assert not [sequence for sequence in RAW if sequence in terminal.output]


def _argosy(*arguments: str) -> bytes:
    done = forked.run(["argosy", *arguments], text=False, timeout=90)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout + done.stderr
