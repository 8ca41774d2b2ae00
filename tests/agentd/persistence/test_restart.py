"""Agents that are killed and started again: real daemons, a real commd, kill -9."""

import random
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.agentd.daemons import end, mission, printed
from tests.support.amount import THOROUGH
from tests.support.processes import Daemon, running

ONE = "mission: one\nagents:\n  a: {{program: a.asl{more}}}\n  b: {{program: b.asl}}\ndone: 'a: never'\n"


class Fleet:
    """A commd and the agents of a mission, each in a daemon of its own."""

    def __init__(self, stack: ExitStack, path: str, endpoint: str, state: Path) -> None:
        self._stack, self._path = stack, path
        self._where = ("--router", endpoint, "--state", str(state))
        self.commd = self.start_commd()

    def start_commd(self) -> Daemon:
        daemon = self._stack.enter_context(running("commd", "serve", self._path, *self._where))
        daemon.says("endpoint=")
        return daemon

    def start(self, agent: str, *arguments: str) -> Daemon:
        return self._stack.enter_context(running("agentd", "serve", self._path, agent, *arguments, *self._where))


@contextmanager
def a_fleet(tmp_path: Path, endpoint: str, text: str, **programs: str) -> Iterator[Fleet]:
    with ExitStack() as stack:
        yield Fleet(stack, mission(tmp_path, text, **programs), endpoint, tmp_path / "state")


STREAM = """\
next(0). expected(0).
!go.
+!go <- !!step.
@step[atomic] +!step : next(N) & N < COUNT & peer(P)
   <- for (.range(I, N, N+9)) { .send(P, tell, m(I)) }; -+next(N+10); !!pause.
+!step.
+!pause <- .wait(5); !!step.
@hear[atomic] +m(N)[source(_)] : expected(E)
   <- -+expected(N+1); if (N \\== E) { .print("WRONG ", N, " for ", E) }; !look.
+!look : expected(COUNT) <- .print("complete").
+!look.
+restarted(_) <- !!step; !look.
"""


@pytest.mark.parametrize("seed", [1, 2] if THOROUGH else [1])
def test_no_message_is_lost_doubled_or_out_of_order_under_kills(tmp_path: Path, endpoint: str, seed: int) -> None:
    chance, count, kills = random.Random(seed), 5000, 8
    text = ONE.format(more=', beliefs: ["peer(b)"]').replace("b.asl", 'a.asl, beliefs: ["peer(a)"]')
    with a_fleet(tmp_path, endpoint, text, a=STREAM.replace("COUNT", str(count))) as fleet:
        live = {name: fleet.start(name) for name in "ab"}
        complete: set[str] = set()
        until = time.monotonic() + 120
        while complete != {"a", "b"}:
            assert time.monotonic() < until, [daemon.text for daemon in live.values()]
            time.sleep(chance.uniform(0.1, 0.8))
            if kills and (victim := chance.choice("abc")):
                kills -= 1
                killed = fleet.commd if victim == "c" else live[victim]
                killed.kill()
                assert "WRONG" not in killed.text
                if victim == "c":
                    fleet.commd = fleet.start_commd()
                else:
                    complete |= {victim} if "complete" in killed.text else set()
                    live[victim] = fleet.start(victim)
            for name, daemon in live.items():
                assert "WRONG" not in daemon.text
                assert "error:" not in daemon.text, daemon.text
                complete |= {name} if "complete" in daemon.text else set()
        for daemon in live.values():
            daemon.says("agents=")  # it may just have been started again
        end(*live.values())


@pytest.mark.parametrize("synchronous", ["full", "normal"] if THOROUGH else ["full"])
def test_no_mail_between_neighbours_is_lost_doubled_or_out_of_order_while_their_daemon_is_killed_amid_commits(
    tmp_path: Path, endpoint: str, synchronous: str
) -> None:
    chance, count, kills = random.Random(synchronous), 20_000, 20 if THOROUGH else 6
    text = ONE.format(more=', beliefs: ["peer(b)"]').replace("b.asl", 'a.asl, beliefs: ["peer(a)"]')
    text += f"mail: {{synchronous: {synchronous}}}\n"
    log = tmp_path / "state" / "one" / "a.minds-wal"
    with a_fleet(tmp_path, endpoint, text, a=STREAM.replace("COUNT", str(count))) as fleet:
        complete: set[str] = set()
        until = time.monotonic() + 200
        for _ in range(kills):
            both = fleet.start("a", "b")
            both.says("agents=")
            _amid_a_commit(log, chance)
            both.kill()
            assert "WRONG" not in both.text
            complete |= {name for name in "ab" if f"[{name}] complete" in both.text}
        both = fleet.start("a", "b")
        while complete != {"a", "b"}:
            assert time.monotonic() < until, both.text
            time.sleep(0.1)
            assert "WRONG" not in both.text
            complete |= {name for name in "ab" if f"[{name}] complete" in both.text}
        end(both)
        assert "error:" not in both.text


def _amid_a_commit(log: Path, chance: random.Random) -> None:
    """Wait until a commit grows the write-ahead log, some time after now, and up to a few milliseconds more."""
    time.sleep(chance.uniform(0.05, 0.5))
    size, until = log.stat().st_size, time.monotonic() + 10
    while log.stat().st_size == size and time.monotonic() < until:
        pass
    time.sleep(chance.choice((0, 0.0005, 0.002)))


LIVES = """\
colour(red).
!begin.
+!begin <- +begun; .print("begun"); !!keep(1).
+!keep(N) <- .print("keeps ", N); .wait(60000).
+!slow(X)[source(S)] <- .print("slow ", X, " for ", S); .wait(60000).
+!recover(X) <- .print("recovers ", X); .wait(60000).
"""
ASKS = """\
!go.
+!go <- .send(a, tell, colour(blue)); .send(a, achieve, slow(7)); .send(a, askAll, colour(_), L); .length(L, N);
   .print("kept ", N).
"""
BACK = '+restarted(N) <- .findall(C, colour(C), L); .print("back ", N, " ", L).\n'


def until_kept(fleet: Fleet) -> Daemon:
    """Start agent a, and b that asks it for something; return a when that is on disk: before, it does not answer."""
    first = fleet.start("a")
    first.says("[a] keeps 1")
    backfill = fleet.start("b", "--fresh")
    backfill.says("[b] kept ")
    end(backfill)
    first.says("[a] slow 7 for b")
    return first


def test_an_agent_that_is_back_goes_on_and_never_begins_again(tmp_path: Path, endpoint: str) -> None:
    with a_fleet(tmp_path, endpoint, ONE.format(more=""), a=LIVES, b=ASKS) as fleet:
        until_kept(fleet).kill()
        second = fleet.start("a")
        second.says("[a] keeps 1")
        second.says("[a] slow 7 for b")
        assert "begun" not in second.text
        assert "agent=a restarted=1 resumed=2" in second.text
        assert "program has changed" not in second.text
        end(second)
        (tmp_path / "a.asl").write_text(LIVES + BACK)
        third = fleet.start("a")
        third.says("[a] slow 7 for b")
        assert printed(third) == ["[a] back 2 [blue,red]", "[a] slow 7 for b"]
        assert "agent=a its program has changed" in third.text
        assert "agent=a left to the program: +!keep(1)" in third.text
        end(third)


def test_a_goal_of_the_mission_file_replaces_what_the_agent_had_in_mind(tmp_path: Path, endpoint: str) -> None:
    text = ONE.format(more=', on_restart: "goal(recover(home))"')
    with a_fleet(tmp_path, endpoint, text, a=LIVES, b=ASKS) as fleet:
        until_kept(fleet).kill()
        second = fleet.start("a")
        second.says("[a] recovers home")
        second.says("[a] slow 7 for b")
        assert sorted(printed(second)) == ["[a] recovers home", "[a] slow 7 for b"]
        end(second)


@pytest.mark.parametrize(("more", "arguments"), [(", on_restart: fresh", ()), ("", ("--fresh",))])
def test_an_agent_started_fresh_is_fresh(tmp_path: Path, endpoint: str, more: str, arguments: tuple[str, ...]) -> None:
    with a_fleet(tmp_path, endpoint, ONE.format(more=more), a=LIVES + BACK, b=ASKS) as fleet:
        until_kept(fleet).kill()
        second = fleet.start("a", *arguments)
        second.says("[a] keeps 1")
        assert printed(second) == ["[a] begun", "[a] keeps 1"]
        end(second)


def test_a_team_that_has_stopped_itself_starts_fresh(tmp_path: Path, endpoint: str) -> None:
    stops = LIVES.replace("+!slow(X)", "+!slow(8) <- .stopMAS(0, 3).\n+!slow(X)")
    asks = "!go.\n+!go <- .send(a, achieve, slow(8)).\n"
    with a_fleet(tmp_path, endpoint, ONE.format(more=""), a=stops, b=asks) as fleet:
        first = fleet.start("a")
        first.says("[a] keeps 1")
        backfill = fleet.start("b")
        assert first.ends() == 3
        end(backfill)
        assert [file.name for file in (tmp_path / "state").rglob("*.minds")] == ["b.minds"]
        second = fleet.start("a")
        second.says("[a] keeps 1")
        assert printed(second) == ["[a] begun", "[a] keeps 1"]
        end(second)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("goal(recover(home)", "`!recover(home`: "),
        ("goal()", "`goal()`: expected a goal such as `goal(recover)`"),
        ("goal(Recover)", "`!Recover`: "),
        ("later", "expected resume, fresh or goal(...), got `later`"),
    ],
)
def test_what_is_no_goal_to_go_on_with_is_reported_before_anything_starts(
    tmp_path: Path, endpoint: str, said: str, expected: str
) -> None:
    path = mission(tmp_path, ONE.format(more=f', on_restart: "{said}"'), a="", b="")
    with running("agentd", "serve", path, "a", "--router", endpoint) as agent:
        assert agent.ends() == 2
        assert expected in agent.text, agent.text
