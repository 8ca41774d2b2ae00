"""Environments in Python: percepts, actions, their outcomes, and what goes wrong in the user's code."""

import threading
from pathlib import Path
from typing import Any, cast

import pytest

from agentd import ActionFailed, Deferred, Environment, literal
from agentd.environment import PerceptBoard
from agentd.extensions.user_code import UserCodeError, load_class
from agentd.language.terms.terms import Literal
from agentd.mind.data.inputs import PerceptsChanged
from agentd.standalone.environment_host import EnvironmentHost
from agentd.standalone.standalone_team import WallClock
from tests.agentd.conftest import agentd
from tests.agentd.minds import mind_of
from tests.agentd.teams import Stage, played


class Lamp(Environment):
    """A lamp that anybody may switch; what it does otherwise is set by its tests."""

    def init(self, arguments: list[str]) -> None:
        self.arguments = arguments
        self.log: list[str] = []
        self.add_percept("lamp(off)")

    def execute(self, agent: str, action: Any) -> bool | Deferred:
        self.log.append(f"{agent}: {action}")
        match action.functor:
            case "switch":
                self.replace_percept(literal("lamp", action.args[0]))
                return True
            case "refuse":
                return False
            case "explain":
                raise ActionFailed("the bulb is gone")
            case "warm_up":
                later = Deferred()
                self.after(30.0, later.succeed)
                return later
            case "burn_out":
                later = Deferred()
                self.after(30.0, lambda: later.fail("too hot"))
                return later
            case "forget":
                return None  # type: ignore[return-value]
            case "break":
                return bool(1 / 0)
        return super().execute(agent, action)

    def stop(self) -> None:
        self.log.append("stopped")


def test_percepts_are_beliefs_with_source_percept_and_actions_change_them() -> None:
    stage = Stage(
        {
            "bob": """
            +lamp(on)[source(S)] : not lamp(off) <- .print("on, by ", S).
            -lamp(off) <- .print("no longer off").
            !s. +!s <- .wait(10); switch(on).
            """
        },
        environment=Lamp(),
    )
    assert stage.run() == 0
    assert stage.lines == ["[bob] no longer off", "[bob] on, by percept"]


def test_a_percept_that_comes_and_goes_between_two_looks_raises_no_event() -> None:
    class Flicker(Lamp):
        def execute(self, agent: str, action: Any) -> bool:
            self.replace_percept("lamp(on)")
            self.replace_percept("lamp(off)")
            self.add_percept("spark")
            self.remove_percept("spark")
            return True

    assert played(
        {"bob": "+lamp(X) <- .print(X). -lamp(X) <- .print(gone, X). +spark <- .print(spark). !s. +!s <- flick."},
        environment=Flicker(),
    ) == ["[bob] off"]


def test_a_percept_that_the_agent_also_believes_itself_stays_when_it_is_gone() -> None:
    assert played(
        {"bob": "!s. +!s <- .wait(10); +lamp(off); switch(on); .wait(10); ?lamp(off)[source(S)]; .print(S)."},
        environment=Lamp(),
    ) == ["[bob] self"]


def test_percepts_of_one_agent_are_not_those_of_another() -> None:
    class Two(Environment):
        def joined(self, agent: str) -> None:
            self.add_percept(literal("i_am", literal(agent)), agent)
            self.add_percept(literal("there_is", literal(agent)))

        def execute(self, agent: str, action: Any) -> bool:
            self.clear_percepts(agent)
            return True

    program = "+i_am(X) <- .print(i_am, X). +there_is(X) <- .print(there_is, X). -i_am(X) <- .print(lost, X)."
    team = {"ann": program + "!s. +!s <- .wait(50); forget_me.", "bob": program}
    assert sorted(played(team, environment=Two())) == [
        "[ann] i_amann",
        "[ann] lostann",
        "[ann] there_isann",
        "[ann] there_isbob",
        "[bob] i_ambob",
        "[bob] there_isann",
        "[bob] there_isbob",
    ]


def test_an_agent_that_is_created_later_perceives_what_holds(tmp_path: Path) -> None:
    (tmp_path / "late.asl").write_text("+lamp(X) <- .print(X).")
    assert played(
        {"bob": f'!s. +!s <- .wait(10); switch(dim); .create_agent(late, "{tmp_path}/late.asl").'}, environment=Lamp()
    ) == ["[late] dim"]


def test_a_clone_keeps_the_percepts_of_all_and_loses_those_of_its_original_alone() -> None:
    class Own(Lamp):
        def init(self, arguments: list[str]) -> None:
            super().init(arguments)
            self.add_percept("only_bob", "bob")

    program = """
        !s. +!s <- .wait(10); .clone("twin").
        +lamp(X) <- .my_name(N); .print(lamp). -only_bob <- .print(lost); ?lamp(X); .print(X).
    """
    assert played({"bob": program}, environment=Own()) == ["[bob] lamp", "[twin] lost", "[twin] off"]


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        ("refuse", "the environment could not do refuse"),
        ("explain", "the bulb is gone"),
        ("burn_out", "too hot"),
        ("fly(1,2)", "the environment has no action fly/2"),
        ("forget", "the environment's execute returned None for forget/0; expected True, False or a Deferred"),
    ],
)
def test_an_action_that_fails_tells_why(action: str, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert played(
        {"bob": f'!s. +!s <- {action}. -!s[error(E), reason(R)] <- .print(E, ": ", R).'}, environment=Lamp()
    ) == [f"[bob] action_failed: {reason}"]


def test_an_error_in_the_users_code_fails_the_action_and_names_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    program = "!s. +!s <- break. -!s[error(E)] <- .print(E)."
    assert played({"bob": program}, environment=Lamp()) == ["[bob] action_failed"]
    told = capsys.readouterr().err
    assert "execute went wrong in break/0: ZeroDivisionError: division by zero (" in told
    assert f"{__file__}:" in told
    assert "Traceback" not in told


def test_a_deferred_action_suspends_its_intention_alone_and_ends_at_its_time() -> None:
    assert played(
        {"bob": "!a. !b. +!a <- .nano_time(T); warm_up; .nano_time(U); .print((U-T)/1000000000). +!b <- .print(b)."},
        environment=Lamp(),
    ) == ["[bob] b", "[bob] 30"]


def test_an_intention_that_is_dropped_cancels_its_action() -> None:
    kept: list[Deferred] = []

    class Slow(Environment):
        def execute(self, agent: str, action: Any) -> Deferred:
            kept.append(Deferred())
            return kept[0]

    stage = Stage({"bob": "!a. !b. +!a <- slow. +!b <- .wait(10); .drop_intention(a)."}, environment=Slow())
    stage.run()
    assert kept[0].cancelled


def test_actions_that_share_an_outcome_end_together_and_it_is_cancelled_when_all_are_gone() -> None:
    kept: list[Deferred] = []

    class Shared(Environment):
        def execute(self, agent: str, action: Any) -> Deferred:
            if not kept:
                kept.append(Deferred())
                self.after(30, kept[0].succeed)
            return kept[0]

    acts = "!a. !b. +!a <- act; .print(a). +!b <- act; .print(b). "
    stage = Stage({"bob": acts + "!c. +!c <- .wait(10); .drop_intention(a)."}, environment=Shared())
    assert (stage.run(20), kept[0].cancelled) == (1, False)
    assert (stage.run(), stage.lines) == (0, ["[bob] b"])
    kept.clear()
    stage = Stage({"ann": acts, "bob": "!a. +!a <- act; .print(done)."}, environment=Shared())
    assert stage.run() == 0
    assert sorted(stage.lines) == ["[ann] a", "[ann] b", "[bob] done"]
    kept.clear()
    stage = Stage({"bob": acts + "!c. +!c <- .wait(10); .drop_all_intentions."}, environment=Shared())
    assert (stage.run(), stage.lines, kept[0].cancelled) == (0, [], True)


def test_another_thread_settles_an_action_and_changes_percepts() -> None:
    class Threaded(Environment):
        def execute(self, agent: str, action: Any) -> Deferred:
            later = Deferred()

            def work() -> None:
                self.add_percept("worked")
                later.succeed()

            threading.Thread(target=work).start()
            return later

    program = "!s. +!s <- work; ?worked; .print(done); .stopMAS(0, 7)."
    stage = Stage({"bob": program}, clock=WallClock(), environment=Threaded())
    assert (stage.run(60.0), stage.lines) == (7, ["[bob] done"])


def test_another_thread_asks_for_a_call_while_the_team_sleeps() -> None:
    asleep = threading.Event()

    class Sleeper(EnvironmentHost):
        def sleep(self, seconds: float) -> None:
            asleep.set()
            super().sleep(seconds)

    class Caller(Environment):
        def ask(self) -> None:
            asleep.wait()
            self.after(0.001, self.ring)

        def ring(self) -> None:
            called.append(threading.current_thread())

    called: list[threading.Thread] = []
    caller = Caller()
    world = Sleeper(caller, WallClock().now, pytest.fail)
    thread = threading.Thread(target=caller.ask)
    thread.start()
    world.sleep(3600)
    while not called:
        world.deliver()
    thread.join()
    assert called == [threading.current_thread()]


def test_a_call_that_asks_for_itself_immediately_keeps_nobody_from_acting() -> None:
    class Busy(Environment):
        def init(self, arguments: list[str]) -> None:
            self.again()

        def again(self) -> None:
            self.after(0, self.again)

    stage = Stage({"bob": "!s. +!s <- .print(here); .stopMAS(0, 3)."}, environment=Busy())
    assert (stage.run(), stage.lines) == (3, ["[bob] here"])


def test_perceive_brings_the_percepts_up_to_date_before_the_next_formula() -> None:
    class Pulled(Environment):
        reads = 0

        def perceive(self, agent: str) -> None:
            self.reads += 1
            self.replace_percept(literal("reading", self.reads))

    assert played(
        {"bob": "!s. +!s <- .perceive; ?reading(A); .perceive; ?reading(B); .print(A, B)."}, environment=Pulled()
    ) == ["[bob] 12"]


def test_the_environment_gets_its_arguments_and_the_end() -> None:
    lamp = Lamp()
    stage = Stage({"bob": "!s. +!s <- switch(on); .stopMAS."}, environment=lamp, environment_arguments=["a", "b"])
    stage.run()
    assert lamp.arguments == ["a", "b"]
    assert lamp.log == ["bob: switch(on)", "stopped"]


MODULE = """
from agentd import Environment, literal

class Counter(Environment):
    def init(self, arguments):
        self.count = int(arguments[0]) if arguments else 0
        self.add_percept(literal("counter", self.count))

    def execute(self, agent, action):
        if action.functor == "next":
            self.count += 1
            self.replace_percept(literal("counter", self.count))
            return True
        return super().execute(agent, action)

class Broken(Environment):
    def init(self, arguments):
        self.count = arguments[3]

class TooEarly(Environment):
    def __init__(self):
        self.after(1.0, print)

not_a_class = 3
class Other: pass
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "world.py").write_text(MODULE)
    (tmp_path / "agent.asl").write_text("+counter(5) <- .print(five); .stopMAS. +counter(N) <- next.")
    return tmp_path


@pytest.mark.parametrize("name", ["world:Counter", "world.py:Counter"])
def test_the_command_finds_the_class_from_the_working_directory(folder: Path, name: str) -> None:
    done = agentd("run", "--env", name, "--env-arg", "2", "agent.asl", cwd=folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[agent] five\n", "")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("world", "`world` does not name a class; write module:Class or file.py:Class"),
        ("nowhere:X", "there is no Python module nowhere (looked in "),
        ("nowhere.py:X", "there is no file nowhere.py"),
        ("world:Contre", "world has no class Contre; there are Broken, Counter, TooEarly"),
        ("world:TooEarly", "world:TooEarly cannot be made: RuntimeError: the run has not begun in __init__: "),
        ("world:Other", "world:Other is not a subclass of Environment; derive it from agentd.environment.Environment"),
        ("world:Broken", "the environment's init failed: IndexError: list index out of range ("),
        ("typo:X", "typo cannot be imported: SyntaxError: "),
    ],
)
def test_a_class_that_cannot_be_used_is_reported_without_a_traceback(folder: Path, name: str, told: str) -> None:
    (folder / "typo.py").write_text("class X(:\n  pass\n")
    done = agentd("run", "--env", name, "agent.asl", cwd=folder)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"--env {name}: error: {told}")
    assert "Traceback" not in done.stderr


def test_a_module_that_fails_in_its_own_imports_names_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "needs_more.py").write_text("import no_such_library\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UserCodeError, match="needs_more cannot be imported: ModuleNotFoundError: No module named"):
        load_class("needs_more:X", Environment)


def test_a_percept_board_gives_what_has_changed_not_all_that_holds() -> None:
    board = PerceptBoard()
    bob = mind_of("")
    board.join("bob")

    def fed() -> list[tuple[Any, Literal | None]]:
        board.feed({"bob": bob})
        changes = [(key[1], new) for item in bob.inputs for key, new in cast(PerceptsChanged, item).percepts.items()]
        bob.inputs.clear()
        return changes

    for number in range(10_000):
        board.add(literal("at", number), None)
    assert len(fed()) == 10_000
    board.remove(literal("at", 7), None)
    board.add(literal("at", 20_000), "bob")
    board.add(literal("at", 8), None)
    board.add(literal("at", 9), "bob")
    assert fed() == [((7.0,), None), ((20_000.0,), literal("at", 20_000)), ((9.0,), literal("at", 9))]
    board.remove(literal("at", 9), None)
    assert fed() == []
