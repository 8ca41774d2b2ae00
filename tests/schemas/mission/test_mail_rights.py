"""Which mail an agent accepts, by the mission."""

from pathlib import Path
from typing import Any

import pytest

from schemas.files.findings import Findings
from schemas.mission.access_rules import MailRights
from schemas.mission.model import PERFORMATIVES, Mission, read_mission
from schemas.wire.records import Message
from schemas.wire.terms import Atom, Structure

FLEET = """
mission: f
SECURITY
boards: {pi1: {address: 10.0.0.1}, pi2: {address: 10.0.0.2}}
agents:
  a: {board: pi1, program: a.asl ACCEPTS}
  near: {board: pi1, program: a.asl}
  far: {board: pi2, program: a.asl}
clients: {planner: {board: pi2}}
gateway: {board: pi1, listen: "127.0.0.1:9000", nodes: {old: "127.0.0.1:9001"}}
"""
PLANS = {"tellHow", "untellHow", "askHow"}


def fleet(accepts: str = "", *, secured: bool = True) -> Mission:
    text = FLEET.replace("SECURITY", "security: {operators: [ops]}" if secured else "")
    return read_mission(text.replace("ACCEPTS", f", accepts: {accepts}" if accepts else ""), Path("m.yaml"))


def accepted(mission: Mission, sender: str, agent: str = "a") -> set[str]:
    rights = MailRights(mission, agent, "pi1")
    return {one for one in PERFORMATIVES if rights.accept(letter(sender, one))}


def letter(sender: str, performative: str, content: Any = 1) -> Message:
    return Message(id="1", sender=sender, performative=performative, receiver="a", content=content)


def test_a_secured_agent_takes_no_plans_from_other_boards() -> None:
    for sender in ("far", "planner", "pi2_kid", "nobody"):
        assert accepted(fleet(), sender) == PERFORMATIVES - PLANS, sender
    for sender in ("a", "near", "pi1_kid"):
        assert accepted(fleet(), sender) == PERFORMATIVES, sender
    assert accepted(fleet(), "far", "pi1_kid") == PERFORMATIVES - PLANS


def test_an_agent_that_is_not_secured_takes_everything_but_what_the_gateway_brings() -> None:
    for sender in ("far", "planner", "kid", "near"):
        assert accepted(fleet(secured=False), sender) == PERFORMATIVES
    for secured in (True, False):
        assert accepted(fleet(secured=secured), "old") == {"tell"}


def test_an_empty_security_secures_as_well() -> None:
    text = FLEET.replace("SECURITY", "security: {}").replace("ACCEPTS", "")
    assert accepted(read_mission(text, Path("m.yaml")), "far") == PERFORMATIVES - PLANS


@pytest.mark.parametrize("secured", [True, False])
def test_who_is_named_may_send_what_stands_there_and_nothing_else(secured: bool) -> None:
    mission = fleet("{far: [tell, tellHow], old: [achieve], planner: all, near: []}", secured=secured)
    assert accepted(mission, "far") == {"tell", "tellHow"}
    assert accepted(mission, "old") == {"achieve"}
    assert accepted(mission, "planner") == PERFORMATIVES
    assert accepted(mission, "near") == set()
    assert accepted(mission, "a") == PERFORMATIVES
    assert accepted(mission, "pi2_kid") == (PERFORMATIVES - PLANS if secured else PERFORMATIVES)


def test_a_star_is_every_agent_that_is_not_named_and_opens_nothing_for_the_gateway() -> None:
    mission = fleet('{"*": [tell, tellHow], near: all}')
    assert accepted(mission, "far") == accepted(mission, "pi2_kid") == {"tell", "tellHow"}
    assert accepted(mission, "near") == PERFORMATIVES
    assert accepted(mission, "old") == {"tell"}
    assert accepted(fleet('{"*": [achieve]}'), "old") == set()
    assert accepted(fleet('{"*": all}'), "old") == {"tell"}


def test_reserved_senders_send_their_notices_alone() -> None:
    for mission in (fleet(), fleet(secured=False), fleet('{"*": []}')):
        rights = MailRights(mission, "a", "pi1")
        undelivered, provider = (
            Structure("undelivered", (Atom("b"),) * 4),
            Structure("provider", (Atom("b"), Atom("s"))),
        )
        assert rights.accept(letter("mail", "signal", undelivered))
        assert rights.accept(letter("df", "tell", provider))
        for sender in ("mail", "df", "percept", "self"):
            assert not rights.accept(letter(sender, "achieve", Structure("arm")))
            assert not rights.accept(letter(sender, "achieve", undelivered))
            assert not rights.accept(letter(sender, "tell", Atom("arm")))
            assert not rights.accept(letter(sender, "signal", Structure("low_battery", (1,))))


@pytest.mark.parametrize(
    ("accepts", "finding"),
    [
        ("{fra: all}", "accepts: there is no agent, client or node `fra`, did you mean `far`?"),
        ("{mail: all}", "accepts: `mail` sends notices alone, which every agent takes: leave it out"),
        ("{far: [tellhow]}", "accepts: no agent handles `tellhow` by itself, did you mean `tellHow`?"),
        ("{far: some}", "agents.a.accepts.far: expected `all` or a list, got `some`"),
    ],
)
def test_what_cannot_be_meant_is_refused(accepts: str, finding: str) -> None:
    with pytest.raises(Findings) as found:
        fleet(accepts)
    assert finding in str(found.value)


def test_a_name_of_a_board_and_a_performative_of_ones_own_can_be_named() -> None:
    mission = fleet("{pi2_kid: [salute]}")
    rights = MailRights(mission, "a", "pi1")
    assert rights.accept(letter("pi2_kid", "salute"))
    assert not rights.accept(letter("pi2_kid", "tell"))
