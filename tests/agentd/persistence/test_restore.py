"""The state of an agent is found wherever it was kept last, and moves with the agent to another daemon."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from agentd.extensions.file_access import KEPT
from agentd.mind.persistence.rows import MindRows
from agentd.persistence.checkpoint import AgentRows, Checkpoint, CheckpointError, LifeRow, Outgoing
from agentd.persistence.restore import RestoredState, forget_name, open_state

FRESH: tuple[str, ...] = ()


def saved(number: int) -> AgentRows:
    return AgentRows(
        mind=MindRows(beliefs=[(number, b"x")], values={"counts": b"c"}, pending=[((0, 1), 2, b"e")]),
        absorbed={("cid", "n"): number},
        incoming=[(number, b"i")],
        outgoing=[Outgoing(1, "cid", number, b"m")],
        next_seq={"cid": number},
        life=LifeRow("mine", number, b"digest"),
    )


def opened(folder: Path, *agents: str, fresh: tuple[str, ...] = FRESH) -> tuple[Checkpoint, dict[str, RestoredState]]:
    """Open the state of a daemon that is named after its first agent."""
    checkpoint, states = open_state(folder, agents[0], agents, fresh, "FULL")
    assert checkpoint is not None
    return checkpoint, states


def ranks(states: dict[str, RestoredState]) -> dict[str, list[int] | None]:
    return {
        name: None if one.stored is None else [rank for rank, _ in one.stored.mind.beliefs]
        for name, one in states.items()
    }


def keep(folder: Path, *agents: str) -> None:
    """Keep a state of each agent, by its place."""
    checkpoint, _ = opened(folder, *agents)
    checkpoint.save({agent: saved(place) for place, agent in enumerate(agents, 1)})
    checkpoint.close()


def test_agents_that_go_to_other_daemons_and_back_keep_their_state_and_none_stays_behind(tmp_path: Path) -> None:
    keep(tmp_path, "a", "b", "c")
    alone, states = opened(tmp_path, "b")
    assert ranks(states) == {"b": [2]}
    assert states["b"].stored is not None
    assert states["b"].stored == saved(2)
    alone.save({"b": AgentRows(mind=MindRows(beliefs=[(7, b"new")]))})
    alone.close()
    others, states = opened(tmp_path, "c", "a")
    assert ranks(states) == {"c": [3], "a": [1]}
    others.close()
    assert sorted(path.name for path in tmp_path.glob("*.minds")) == ["b.minds", "c.minds"]
    together, states = opened(tmp_path, "a", "b", "c")
    assert ranks(states) == {"a": [1], "b": [2, 7], "c": [3]}
    assert [note for one in states.values() for note in one.notes] == []
    together.close()
    assert [path.name for path in tmp_path.glob("*.minds")] == ["a.minds"]


def test_the_state_of_an_agent_that_another_daemon_has_open_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.process.sqlite_file.LOCK_PATIENCE", 0.05)
    keep(tmp_path, "a", "b")
    other, _ = opened(tmp_path, "a")
    with pytest.raises(CheckpointError, match="it has the state of b: end the agentd that had them before"):
        open_state(tmp_path, "b", ["b"], [], "FULL")
    other.close()
    found, states = opened(tmp_path, "b")
    assert ranks(states) == {"b": [2]}
    found.close()


def test_a_move_cut_short_is_repeated_from_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep(tmp_path, "a", "b")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("agentd.persistence.restore._name", full)
        with pytest.raises(CheckpointError, match="No space left"):
            open_state(tmp_path, "b", ["b"], [], "FULL")
    again, _ = opened(tmp_path, "a", "b")
    again.save({"b": AgentRows(mind=MindRows(beliefs=[(8, b"later")], beliefs_gone=[2]))})
    again.close()
    moved, states = opened(tmp_path, "b")
    assert ranks(states) == {"b": [8]}
    moved.close()


def test_a_file_that_has_vanished_is_reported_by_the_agents_whose_state_it_had(tmp_path: Path) -> None:
    keep(tmp_path, "a", "b")
    (tmp_path / "a.minds").unlink()
    checkpoint, states = opened(tmp_path, "b")
    assert ranks(states) == {"b": None}
    assert [note.identity for note in states["b"].notes] == [("state_damaged", "b")]
    checkpoint.close()


@pytest.mark.parametrize("content", ["", "a.min", "../x.minds\n", "\udcff"])
def test_a_name_that_a_power_failure_has_cut_counts_as_none(tmp_path: Path, content: str) -> None:
    keep(tmp_path, "a")
    (tmp_path / "a" / KEPT).write_bytes(content.encode(errors="surrogateescape"))
    checkpoint, states = opened(tmp_path, "a")
    assert ranks(states) == {"a": [1]}
    checkpoint.close()


def test_agents_that_start_fresh_leave_the_state_of_the_others(tmp_path: Path) -> None:
    keep(tmp_path, "a", "b")
    checkpoint, states = opened(tmp_path, "a", "b", fresh=("b",))
    assert ranks(states) == {"a": [1], "b": None}
    assert list(checkpoint.read()) == ["a"]
    checkpoint.close()


def test_without_an_agent_to_keep_there_is_no_file_and_old_state_is_removed(tmp_path: Path) -> None:
    assert open_state(tmp_path, "a", [], ["a"], "FULL") == (None, {})
    assert list(tmp_path.iterdir()) == []
    keep(tmp_path, "a")
    assert open_state(tmp_path, "a", [], ["a"], "FULL") == (None, {})
    assert list(tmp_path.glob("*.minds")) == []
    _, states = opened(tmp_path, "a")
    assert ranks(states) == {"a": None}


def test_a_file_of_a_newer_version_is_not_moved_out_of(tmp_path: Path) -> None:
    keep(tmp_path, "a", "b")
    with closing(sqlite3.connect(tmp_path / "a.minds")) as database:
        database.execute("PRAGMA user_version = 99")
    with pytest.raises(CheckpointError, match="newer Argosy"):
        open_state(tmp_path, "b", ["b"], [], "FULL")


def test_an_agent_whose_name_is_forgotten_has_no_past_elsewhere(tmp_path: Path) -> None:
    keep(tmp_path, "a", "b")
    forget_name(tmp_path, "b")
    checkpoint, states = opened(tmp_path, "b")
    assert ranks(states) == {"b": None}
    checkpoint.close()
