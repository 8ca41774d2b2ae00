"""Who may put, serve, ask and see what, by the mission."""

from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import zenoh

from commd.router.config import access_control
from schemas.files.findings import Findings
from schemas.files.shipped_files import shipped_names
from schemas.mission import access_rules
from schemas.mission.access_rules import Rights
from schemas.mission.model import Mission, read_mission
from schemas.wire import keys

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
    if who in ("ops", "eye"):
        return access_rules.of_operator() if who == "ops" else access_rules.of_observer("telemetry")
    return access_rules.of_board(mission(), who)


@pytest.mark.parametrize(
    ("right", "key", "who"),
    [
        ("puts", keys.percept("f", "a", "pose"), "pi2"),
        ("puts", keys.percepts("f", "a"), "pi2"),  # a's robot is there
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
    for key in (keys.percept("f", "a", "pose"), keys.services("f", "pi2")):
        assert covers(rights.asks, key)


SECRETS = {keys.mind("f", "b"): "minds", keys.trace("f", "b", "decisions"): "minds"}
SECRETS |= {keys.trace("f", "b", "inputs"): "mail", keys.trace("f", "b", "activity"): "mail"}


@pytest.mark.parametrize(("key", "right"), SECRETS.items())
def test_minds_and_mail_are_seen_by_whom_the_mission_lets(key: str, right: keys.Sight) -> None:
    asked = key.endswith(("/mind", "/inputs"))
    for sight in keys.SIGHTS:
        sees = keys.SIGHTS.index(sight) >= keys.SIGHTS.index(right)
        assert covers(access_rules.of_observer(sight).asks, key) == (sees and asked), sight
        assert covers(access_rules.hidden(sight), key) != sees, sight
    assert covers(access_rules.of_operator().asks, key) == asked
    assert covers(access_rules.of_member(mission(), "pi2").asks, key) == asked
    assert not covers(access_rules.of_board(mission(), "pi1").asks, key)
    assert covers(access_rules.hidden(access_rules.BOARD_SEES), key)


@pytest.mark.parametrize("sight", keys.SIGHTS)
def test_nothing_that_may_be_asked_meets_what_is_hidden(sight: keys.Sight) -> None:
    for asked in access_rules.of_observer(sight).asks:
        for secret in access_rules.hidden(sight):
            assert not zenoh.KeyExpr(asked).intersects(zenoh.KeyExpr(secret))


def test_the_routers_tell_each_observer_what_the_mission_says() -> None:
    found = mission(FLEET.replace("[eye]", "{eye: telemetry, mate: minds, judge: mail}"))
    control = access_control(found, "pi1")
    subject = {name: one["id"] for one in control["subjects"] for name in one.get("cert_common_names", ())}
    denied = {rule["id"]: set(rule["key_exprs"]) for rule in control["rules"] if rule["permission"] == "deny"}
    rules = {policy["subjects"][0]: policy["rules"] for policy in control["policies"]}
    unseen = {name: set[str]().union(*(denied.get(rule, ()) for rule in rules[of])) for name, of in subject.items()}
    assert unseen["eye"] == unseen["pi2"] == set(access_rules.hidden("telemetry"))
    assert unseen["mate"] == set(access_rules.hidden("minds")) < unseen["eye"]
    assert unseen["judge"] == unseen["ops"] == set()
    assert mission().security.sights == {"eye": "telemetry"}


def test_the_page_says_who_sees_what_as_the_rules_do() -> None:
    page = (Path(__file__).parents[3] / "docs/guides/security.md").read_text(encoding="utf-8")
    section = page.partition("### Who sees what\n")[2].partition("\n#")[0]
    shown = {line.split("|")[1].strip(" `"): line for line in section.splitlines() if line.startswith("| `")}
    assert tuple(shown) == keys.SIGHTS
    for key in {channel.key.partition("/")[2] for channel in keys.CHANNELS}:
        sights = {channel.sight for channel in keys.CHANNELS if channel.key.partition("/")[2] == key}
        for sight, line in shown.items():
            assert (f"`{key}`" in line) == (sight in sights), (key, sight)


def test_operators_stop_robots_and_list_the_mail_and_observers_do_not() -> None:
    of_robots = (keys.stop, keys.manifest, keys.parameters, keys.stored_plan)
    for key in (*(key("f", "r1") for key in of_robots), keys.mailboxes("f", "pi1")):
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
    for right, key in (*acts, ("puts", keys.percept_by_hand("f", "a", "victim"))):
        assert covers(getattr(access_rules.of_operator(inject=True), right), key), key
        assert not covers(getattr(access_rules.of_operator(), right), key), key
        assert not covers(getattr(access_rules.of_observer("mail"), right), key), key
        assert covers(getattr(access_rules.of_member(mission(f"{FLEET}inject: true"), "pi1"), right), key)
        if right == "puts":
            assert not covers(access_rules.of_member(mission(), "pi1").puts, key)
    assert not access_rules.of_operator(inject=True).serves
    assert not access_rules.of_operator(inject=True).holds


def test_every_channel_is_somebodys_to_speak_on_and_to_ask() -> None:
    for channel in keys.CHANNELS:
        names = {"{agent}": "a", "{receiver}": "a", "{board}": "pi2", "{robot}": "r1", "{name}": "a", "{sender}": "b"}
        chunks = [names.get(chunk, "x" if chunk.startswith(("{", "*")) else chunk) for chunk in channel.key.split("/")]
        key = "/".join(["argosy", "f", *chunks])
        right = {"put": "puts", "query": "serves", "token": "holds"}[channel.kind]
        if channel.key == "{agent}/percept_by_hand/{name}":
            assert covers(access_rules.of_operator(inject=True).puts, key)
            continue
        speakers = [who for who in ("pi1", "pi2", "ops") if covers(getattr(rights_of(who), right), key)]
        assert len(speakers) == 1, channel.key
        if channel.kind == "query":
            assert any(covers(rights_of(who).asks, key) for who in ("pi1", "pi2", "ops")), channel.key


def test_a_robot_on_zenoh_speaks_on_its_own_board_alone() -> None:
    assert access_rules.robot_keys(mission(), "pi2") == ("turtles/one/**",)
    assert access_rules.robot_keys(mission(), "pi1") == ()
    bare = mission(FLEET.replace(", prefix: turtles/one", ""))
    assert "turtle1/pose" in access_rules.robot_keys(bare, "pi2")
    simulated = mission(FLEET.replace("prefix: turtles/one", "prefix: one, simulate: {vehicle: turtle, board: pi1}"))
    assert access_rules.robot_keys(simulated, "pi1", "pi2") == ("one/**",)


def test_a_name_that_looks_as_if_another_board_had_made_it_is_refused() -> None:
    access_rules.check(mission())
    with pytest.raises(
        Findings, match="`pi1_b` belongs to pi2, but names that begin with `pi1_` are for agents that pi1"
    ):
        access_rules.check(mission(FLEET.replace("  b:", "  pi1_b:")))
    with pytest.raises(Findings, match="`pi2_eye` is no agent"):
        access_rules.check(mission(FLEET.replace("[eye]", "[pi2_eye]")))


def test_two_boards_that_cannot_reach_each_other_are_refused() -> None:
    text = FLEET.replace("{address: 10.0.0.1}", "{}").replace("{address: 10.0.0.2}", "{}")
    with pytest.raises(Findings, match="boards pi1 and pi2 have no address: neither can dial the other"):
        access_rules.check(mission(text))


@pytest.mark.parametrize("name", shipped_names("missions", ".yaml"))
def test_the_shipped_missions_can_be_secured(name: str) -> None:
    from schemas.files.shipped_files import shipped
    from schemas.mission.model import load_mission

    file = shipped("missions", f"{name}.yaml") or shipped("missions", name)
    assert file is not None
    found = load_mission(file)
    access_rules.check(found)
    for board in found.board_names:
        assert access_rules.of_member(found, board).puts
