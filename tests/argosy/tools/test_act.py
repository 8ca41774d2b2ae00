"""`argosy act` against a flying mission: real daemons, a simulated copter, the command as a user types it."""

import asyncio
import json
import re
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from argosy.__main__ import main
from argosy.tools.act import _perform
from argosy.tools.record_text import read_action
from commd.bus.bus import Bus
from schemas.wire.records import ActionStatus, Header
from schemas.wire.term_text import BadTerm
from schemas.wire.terms import Atom, Structure, Term
from tests.argosy.tools.flying import Trial, trial
from tests.support import forked
from tests.support.processes import ROOT, running


@pytest.fixture(scope="module")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    with trial(tmp_path_factory.mktemp("trial")) as mission:
        yield mission


def act(flying: Trial, *words: str) -> tuple[int, list[str], str]:
    """Type a command; return its exit code, the lines that it printed, and what it said besides."""
    done = forked.run(["argosy", "act", *words, "--router", flying.endpoint], timeout=120, cwd=ROOT)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout.splitlines(), done.stderr.strip()


def test_an_action_is_followed_in_words_to_its_success(flying: Trial) -> None:
    assert act(flying, "uav", "set_mode", "GUIDED")[0] == 0
    code, lines, said = act(flying, "uav", "arm_motors", "true", "--fleet", "trial")
    assert (code, said) == (0, "")
    assert lines[-1] == "uav: arm_motors(true) succeeded"
    code, lines, said = act(flying, "uav", "takeoff(20)")
    assert (code, said) == (0, ""), lines
    assert re.fullmatch(r"uav: takeoff\(20\) accepted, \d+ s at most, id operator:\w+:1", lines[0])
    assert any(re.match(r"uav: takeoff\(20\) running, altitude [\d.]+, to_go [\d.]+", line) for line in lines), lines
    assert lines[-1] == "uav: takeoff(20) succeeded"


def test_the_parameter_that_it_asks_for_is_printed(flying: Trial) -> None:
    code, lines, said = act(flying, "uav", "get_param", "RTL_ALT")
    assert (code, said) == (0, "")
    assert lines[-2:] == ['uav: get_param("RTL_ALT") succeeded', 'uav: parameter("RTL_ALT",1500)']


def test_ctrl_c_cancels_it_and_says_what_became_of_it(flying: Trial) -> None:
    words = ("argosy", "act", "uav", "goto", "-27.600", "-48.515", "20", "--mission", str(flying.path))
    with running(*words) as goto:
        goto.says("goto(-27.6,-48.515,20) running")
        goto.signal(signal.SIGINT)
        assert goto.ends() == 130
    assert "uav: goto(-27.6,-48.515,20): ctrl-C, cancelling it" in goto.lines
    assert goto.lines[-1].startswith("uav: goto(-27.6,-48.515,20) cancelled: cancelled by ")


@pytest.mark.parametrize(("number", "name"), [(signal.SIGTERM, "SIGTERM"), (signal.SIGHUP, "SIGHUP")])
def test_what_ends_the_command_cancels_the_action(flying: Trial, number: int, name: str) -> None:
    words = ("argosy", "act", "uav", "goto", "-27.600", "-48.515", "20", "--mission", str(flying.path))
    with running(*words) as goto:
        goto.says("goto(-27.6,-48.515,20) running")
        goto.signal(number)
        assert goto.ends() == 128 + number
    assert f"uav: goto(-27.6,-48.515,20): {name}, cancelling it" in goto.lines
    assert goto.lines[-1].startswith("uav: goto(-27.6,-48.515,20) cancelled: cancelled by ")
    code, lines, _ = act(flying, "uav", "set_mode", "GUIDED")
    assert code == 0, f"nothing runs any more: {lines}"


def test_what_ends_otherwise_is_a_failure(flying: Trial) -> None:
    code, lines, _ = act(flying, "uav", "takeoff", "500")
    assert (code, lines) == (1, ["uav: takeoff(500) refused: takeoff: expected altitude: float 1..120 m, got 500"])
    code, lines, _ = act(flying, "uav", "goto", "-27.600", "-48.515", "20", "--deadline", "2s")
    assert code == 1
    assert lines[0].startswith("uav: goto(-27.6,-48.515,20) accepted, 2 s at most, id operator:")
    assert "timed out: not done within 2 s; it waited for " in lines[-1]


def test_without_an_action_it_says_which_there_are(flying: Trial) -> None:
    code, lines, _ = act(flying, "uav")
    assert code == 0
    assert "takeoff(altitude: float 1..120 m)" in lines
    assert "release()" in lines


def test_what_is_not_there_is_said_with_what_is(flying: Trial) -> None:
    code, _, said = act(flying, "uav", "take_of", "5")
    assert code == 2
    assert said == "error: uav: there is no action `take_of`, did you mean `takeoff`?"
    code, _, said = act(flying, "uaf", "takeoff", "5")
    assert code == 1
    assert said == (
        f"error: no bridge at {flying.endpoint} answers for `uaf`: there is no agent `uaf`, did you mean `uav`?"
    )
    code, _, said = act(flying, "base", "takeoff", "5")
    assert (code, said) == (1, "error: agent `base` is running, but no bridge answers for its robot")


def test_a_reader_that_goes_does_not_end_the_action(flying: Trial) -> None:
    command = f"{sys.executable} -m argosy act uav goto -27.6042 -48.5184 20 --router {flying.endpoint}"
    piped = ["bash", "-c", f"set -o pipefail; {command} | head -n 1"]  # the exit code is that of the action
    done = subprocess.run(piped, capture_output=True, text=True, timeout=120, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    assert " accepted, " in done.stdout
    assert done.stdout.count("\n") == 1
    code, lines, _ = act(flying, "uav", "goto", "-27.6042", "-48.5184", "20")
    assert code == 0
    assert len(lines) <= 3, "it was there already"


def test_what_nobody_can_read_is_no_success(flying: Trial) -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "argosy", "act", "uav", "--router", flying.endpoint]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, cwd=ROOT)
    assert (done.returncode, done.stderr) == (1, "error: the output cannot be written: No space left on device\n")


def test_percepts_by_hand_reach_the_mind_and_leave_it(flying: Trial) -> None:
    options = ["--mode", "client", "--connect", flying.endpoint, "--cfg", "scouting/multicast/enabled:false"]

    def put(agent: str, **fields: object) -> None:
        zenoh = Path(sys.executable).with_name("zenoh")
        value = json.dumps(fields)
        what = ["put", "-k", f"argosy/trial/{agent}/percept_by_hand/victim", "-v", value]
        subprocess.run([zenoh, *options, *what], check=True, timeout=60, capture_output=True)

    for agent in ("uav", "base"):
        put(agent, name="victim", parameters=[1, 2, 3])
        flying.agentd.says(f"[{agent}] victim at 1 from percept")
        put(agent, update="remove")
        flying.agentd.says(f"[{agent}] no victim at 1")


def test_without_inject_it_is_refused_and_the_field_is_named(tmp_path: Path) -> None:
    with trial(tmp_path / "no", inject=False) as mission:
        code, lines, _ = act(mission, "uav", "takeoff", "5")
        assert code == 1
        assert lines == [
            "uav: takeoff(5) refused: asked by hand, which this mission does not allow; say `inject: true` in the "
            "mission file to allow it"
        ]


def test_a_bridge_that_is_killed_meanwhile_is_no_success(flying: Trial) -> None:
    """The last test of the module's mission: its bridge is gone after it."""
    with running("argosy", "act", "uav", "goto", "-27.600", "-48.515", "20", "--router", flying.endpoint) as goto:
        goto.says(" running")
        flying.bridged.kill()
        assert goto.ends() == 1
    assert goto.lines[-1].startswith("uav: goto(-27.6,-48.515,20) NOT confirmed, how it ended is not known: ")


def test_an_order_to_cancel_that_comes_before_the_action_is_given_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = iter(("refused", "cancelled"))

    async def follow(*_: object) -> AsyncGenerator[ActionStatus, None]:
        await asyncio.Event().wait()
        yield ActionStatus(id="i", state="running")

    async def cancel(*_: object) -> ActionStatus:
        return ActionStatus(id="i", state=next(answers))  # type: ignore[arg-type]

    monkeypatch.setattr("argosy.tools.act.follow", follow)
    monkeypatch.setattr("argosy.tools.act.cancel", cancel)
    monkeypatch.setattr("argosy.tools.act.OVERTAKEN", 0.0)
    bus = SimpleNamespace(name="ops", boot="b", header=lambda _: Header())

    async def body() -> int:
        action_client = asyncio.create_task(_perform(cast(Bus, bus), "f", "uav", "land", (), None))
        await asyncio.sleep(0)
        action_client.cancel()
        return await action_client

    assert asyncio.run(body()) == 130
    assert capsys.readouterr().out.splitlines() == ["uav: land: ctrl-C, cancelling it", "uav: land cancelled"]


@pytest.mark.parametrize(
    ("words", "name", "parameters"),
    [
        (["land"], "land", ()),
        (["land()"], "land", ()),
        (["takeoff", "5"], "takeoff", (5,)),
        (["goto(-27.5, -48, 20)"], "goto", (-27.5, -48, 20)),
        (["say", "GUIDED", '"a b"', "guided", "true"], "say", ("GUIDED", "a b", Atom("guided"), True)),
        (["go", "[1,[X,2]]", "at(1,2)"], "go", ([1, ["X", 2]], Structure("at", (1, 2)))),
    ],
)
def test_actions_are_typed_as_programs_write_them(words: list[str], name: str, parameters: tuple[Term, ...]) -> None:
    assert read_action(words[0], words[1:]) == (name, parameters)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["go", "1,2"], "argument 1: expected the end of the term at character 2, got `,`"),
        (["go", "1", "(1+2)"], "argument 2: expected a value, got `(1+2)`"),
        (["go(1)", "2"], "`go(1)` has its arguments in brackets: leave out `2`"),
        (["go(1"], "expected `)`"),
    ],
)
def test_what_is_no_value_is_said(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadTerm) as bad:
        read_action(words[0], words[1:])
    assert message in str(bad.value)
    assert main(["act", "uav", *words]) == 2
    assert message in capsys.readouterr().err
