"""Who may put, serve, ask and see what, by the mission."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from schemas import access, keys
from schemas.access import Rights
from schemas.findings import Findings
from schemas.mission import Mission, read_mission
from schemas.shipped import shipped_names

FLEET = """
mission: m
fleet: f
security: {operators: [ops], observers: [eye]}
boards: {pi1: {address: 10.0.0.1}, pi2: {address: 10.0.0.2}}
agents:
  a: {board: pi1, program: a.asl, robot: r1}
  b: {board: pi2, program: b.asl}
robots:
  r1: {board: pi2, manifest: turtle, prefix: turtles/one}
clients:
  c: {board: pi1}
gateway: {board: pi2, listen: "127.0.0.1:9000", nodes: {n: "127.0.0.1:9001"}}
"""


def mission(text: str = FLEET) -> Mission:
    return read_mission(text, Path("m.yaml"))


def covers(rules: tuple[str, ...], key: str) -> bool:
    """Whether a rule includes a key that has no wildcards."""
    patterns = [rule.replace("$*", "*").replace("/**", "/*") for rule in rules]
    return any(fnmatchcase(key, one) or fnmatchcase(f"{key}/", one) for one in patterns)


def rights_of(who: str) -> Rights:
    return {"eye": access.of_observer, "ops": access.of_operator}.get(who, lambda: access.of_board(mission(), who))()


@pytest.mark.parametrize(
    ("right", "key", "who"),
    [
        ("puts", keys.percept("f", "a", "pose"), "pi2"),  # a's robot is there
        ("puts", keys.status("f", "a", "move"), "pi2"),
        ("serves", keys.action("f", "a", "move"), "pi2"),
        ("asks", keys.action("f", "a", "move"), "pi1"),  # a is here
        ("asks", keys.cancel("f", "a"), "pi1"),
        ("asks", keys.mail("f", "b", "a"), "pi1"),
        ("asks", keys.mail("f", "b", "c"), "pi1"),
        ("asks", keys.mail("f", "a", "n"), "pi2"),  # a node of the gateway
        ("asks", keys.mail("f", "b", "pi1_made"), "pi1"),
        ("serves", keys.mail("f", "a", "b"), "pi1"),
        ("serves", keys.inbox("f", "b"), "pi2"),
        ("serves", keys.mind("f", "b"), "pi2"),
        ("serves", keys.stop("f", "r1"), "pi2"),
        ("puts", keys.services("f", "pi1"), "pi1"),
        ("asks", keys.service_requests("f", "pi1", "anybody"), "pi1"),
        ("puts", keys.health("f", "pi1_made", "agentd"), "pi1"),
        ("holds", keys.alive("f", "c", "client", "1"), "pi1"),
        ("holds", keys.alive("f", "r1", "bridged", "1"), "pi2"),
        ("holds", keys.alive("f", "pi2", "commd", "1"), "pi2"),
    ],
)
def test_what_is_said_under_a_name_comes_from_its_board_alone(right: str, key: str, who: str) -> None:
    for one in ("pi1", "pi2", "ops", "eye"):
        assert covers(getattr(rights_of(one), right), key) == (one == who), one


@pytest.mark.parametrize("who", ["pi1", "pi2", "ops", "eye"])
def test_everybody_looks_on(who: str) -> None:
    rights = rights_of(who)
    assert rights.hears == rights.watches == ("argosy/**",)
    for key in (keys.percept("f", "a", "pose"), keys.mind("f", "b"), keys.services("f", "pi2")):
        assert covers(rights.asks, key)


def test_operators_stop_robots_and_list_the_mail_and_observers_do_not() -> None:
    for key in (keys.stop("f", "r1"), keys.manifest("f", "r1"), keys.mailboxes("f", "pi1")):
        assert covers(rights_of("ops").asks, key)
        assert not covers(rights_of("eye").asks, key)
        assert not covers(rights_of("pi1").asks, key)
    assert rights_of("eye").puts == rights_of("eye").serves == rights_of("eye").holds == ()


def test_operators_act_and_tell_percepts_by_hand_where_the_mission_says_inject() -> None:
    acts = [
        ("asks", keys.action("f", "a", "move")),
        ("asks", keys.action("f", "a", "*")),
        ("asks", keys.cancel("f", "a")),
    ]
    for right, key in (*acts, ("puts", keys.percept("f", "a", "victim"))):
        assert covers(getattr(access.of_operator(inject=True), right), key), key
        assert not covers(getattr(access.of_operator(), right), key), key
        assert not covers(getattr(access.of_observer(), right), key), key
        assert covers(getattr(access.of_member(mission(f"{FLEET}inject: true"), "pi1"), right), key)
        if right == "puts":
            assert not covers(access.of_member(mission(), "pi1").puts, key)
    assert not access.of_operator(inject=True).serves
    assert not access.of_operator(inject=True).holds


def test_every_channel_is_somebodys_to_speak_on_and_to_ask() -> None:
    for channel in keys.CHANNELS:
        names = {"{agent}": "a", "{receiver}": "a", "{board}": "pi2", "{robot}": "r1", "{name}": "a", "{sender}": "b"}
        chunks = [names.get(chunk, "x" if chunk.startswith(("{", "*")) else chunk) for chunk in channel.key.split("/")]
        key = "/".join(["argosy", "f", *chunks])
        right = {"put": "puts", "query": "serves", "token": "holds"}[channel.kind]
        assert sum(covers(getattr(rights_of(board), right), key) for board in ("pi1", "pi2")) == 1, channel.key
        if channel.kind == "query":
            assert any(covers(rights_of(who).asks, key) for who in ("pi1", "pi2", "ops")), channel.key


def test_a_robot_on_zenoh_speaks_on_its_own_board_alone() -> None:
    assert access.robot_keys(mission(), "pi2") == ("turtles/one/**",)
    assert access.robot_keys(mission(), "pi1") == ()
    bare = mission(FLEET.replace(", prefix: turtles/one", ""))
    assert "turtle1/pose" in access.robot_keys(bare, "pi2")
    simulated = mission(FLEET.replace("prefix: turtles/one", "prefix: one, simulate: {vehicle: turtle, board: pi1}"))
    assert access.robot_keys(simulated, "pi1", "pi2") == ("one/**",)


def test_a_name_that_looks_as_if_another_board_had_made_it_is_refused() -> None:
    access.check(mission())
    with pytest.raises(
        Findings, match="`pi1_b` lives on pi2, but names that begin with `pi1_` are for agents that pi1"
    ):
        access.check(mission(FLEET.replace("  b:", "  pi1_b:")))
    with pytest.raises(Findings, match="`pi2_eye` is no agent"):
        access.check(mission(FLEET.replace("[eye]", "[pi2_eye]")))


def test_two_boards_that_cannot_reach_each_other_are_refused() -> None:
    text = FLEET.replace("{address: 10.0.0.1}", "{}").replace("{address: 10.0.0.2}", "{}")
    with pytest.raises(Findings, match="boards pi1 and pi2 have no address: neither can dial the other"):
        access.check(mission(text))


@pytest.mark.parametrize("name", shipped_names("missions", ".yaml"))
def test_the_shipped_missions_can_be_secured(name: str) -> None:
    from schemas.mission import load_mission
    from schemas.shipped import shipped

    file = shipped("missions", f"{name}.yaml") or shipped("missions", name)
    assert file is not None
    found = load_mission(file)
    access.check(found)
    for board in found.board_names:
        assert access.of_member(found, board).puts
