"""An agent that is killed does nothing more, and leaves nothing behind that its team waits for or falls over."""

from typing import Any

import pytest

from agentd import Deferred, Environment
from tests.agentd.teams import Stage


class Never(Environment):
    """Its actions are begun and stay without an outcome."""

    def init(self, arguments: list[str]) -> None:
        self.begun: list[tuple[str, str]] = []
        self.deferred: list[Deferred] = []

    def execute(self, agent: str, action: Any) -> Deferred:
        self.begun.append((agent, str(action)))
        self.deferred.append(Deferred())
        return self.deferred[-1]


@pytest.mark.parametrize("victims_first", [True, False])
def test_an_agent_killed_by_another_does_nothing_more_in_that_turn(victims_first: bool) -> None:
    agents = {"bob": "!s. +!s <- .wait(10); act; .print(alive).", "ann": "!s. +!s <- .wait(10); .kill_agent(bob)."}
    environment = Never()
    stage = Stage(agents if victims_first else dict(reversed(agents.items())), environment=environment)
    assert stage.run() == 0
    assert environment.begun == ([("bob", "act")] if victims_first else [])
    assert all(deferred.cancelled for deferred in environment.deferred)
    assert stage.lines == []


def test_an_agent_that_kills_itself_does_nothing_more_and_nobody_waits_for_its_actions() -> None:
    environment = Never()
    program = """
        !s. !t. !u.
        +!s <- .my_name(N); .kill_agent(N); act; .print(after).
        +!t <- for (.range(I, 1, 9)) { act(I) }.
        +!u <- for (.range(I, 1, 9)) { .print(I) }.
    """
    stage = Stage({"bob": program}, environment=environment)
    stage.team.turns()
    done, lines = list(environment.begun), list(stage.lines)
    assert stage.run() == 0
    assert "bob" not in stage.team.minds
    assert (environment.begun, stage.lines) == (done, lines)
    assert all(deferred.cancelled for deferred in environment.deferred)
    assert "[bob] after" not in stage.lines


def test_a_subscriber_that_is_gone_does_not_stop_those_who_register() -> None:
    gone = "!g. !h. +!g <- .my_name(N); .kill_agent(N). +!h <- .df_subscribe(svc)."
    stage = Stage({"gone": gone, "reg": "!g. +!g <- .wait(100); .df_register(svc); .print(registered)."})
    assert stage.run() == 0
    assert stage.lines == ["[reg] registered"]


def test_the_action_of_a_killed_agent_is_not_taken_for_one_of_its_successor() -> None:
    environment = Never()
    ann = """
        !s.
        +!s <- .wait(10); .kill_agent(bob); .wait(10); .create_agent(bob);
               .send(bob, tellHow, "+!s <- act; .print(done).", l); .send(bob, achieve, s).
    """
    stage = Stage({"bob": "!s. +!s <- act; .print(done).", "ann": ann}, environment=environment)
    stage.run()
    assert [agent for agent, _ in environment.begun] == ["bob", "bob"]
    environment.deferred[0].succeed()
    stage.run()
    assert "[bob] done" not in stage.lines
    environment.deferred[1].succeed()
    stage.run()
    assert stage.lines[-1] == "[bob] done"


def test_the_services_of_a_killed_agent_are_gone() -> None:
    looker = "!s. +!s <- .wait(100); .df_search(svc, L); .print(L); .kill_agent(gone); .df_search(svc, M); .print(M)."
    stage = Stage({"gone": "!g. +!g <- .df_register(svc).", "bob": "!g. +!g <- .df_register(svc).", "ann": looker})
    assert stage.run() == 0
    assert stage.lines == ["[ann] [gone,bob]", "[ann] [bob]"]
