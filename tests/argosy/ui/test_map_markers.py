"""What stands on the map: victims and how they are, targets of running actions, waypoints, areas."""

from argosy.ui.map_markers import literal, marks
from argosy.ui.view_structs import MarkView
from schemas.wire.mind_records import BeliefView
from tests.argosy.fleet_model.fleet import Fleet, rescue

VICTIM = (-27.6035, -48.5182)


def by_id(fleet: Fleet, **beliefs: tuple[str, ...]) -> dict[str, MarkView]:
    for agent, texts in beliefs.items():
        fleet.mind(agent).model.agents[agent].believed = tuple(BeliefView(text=text) for text in texts)
    return {one.id: one for one in marks(fleet.model).marks}


def test_a_victim_that_was_perceived_is_missing_until_somebody_believes_otherwise() -> None:
    fleet = rescue().percept("scout", "victim", 7, *VICTIM)
    assert by_id(fleet)["victim 7"].state == "missing"
    promised = by_id(fleet, scout=("held(7,rescuer1)[source(self)]",))["victim 7"]
    assert (promised.state, promised.position) == ("promised to rescuer1", VICTIM)
    rescued = by_id(fleet, scout=("held(7,rescuer1)",), rescuer1=("rescued(7)[source(self)]",))["victim 7"]
    assert rescued.state == "rescued"


def test_a_victim_that_agents_only_believe_in_is_one_mark_with_all_of_them() -> None:
    text = f"victim(7,{VICTIM[0]},{VICTIM[1]})[source(scout)]"
    found = by_id(rescue(), scout=(f"found(7,{VICTIM[0]},{VICTIM[1]})",), rescuer1=(text,))
    assert list(found) == ["victim 7"]
    assert found["victim 7"].agents == ("rescuer1", "scout")


def test_a_target_is_there_while_its_action_runs() -> None:
    fleet = rescue().action("scout", 1, "goto", "running", *VICTIM, 20)
    target = by_id(fleet)["scout:1:1"]
    assert (target.kind, target.label, target.position) == ("target", "goto", VICTIM)
    assert not by_id(fleet.action("scout", 1, "goto", "succeeded", *VICTIM, 20))


def test_an_area_is_a_rectangle_near_the_fleet_and_nothing_else() -> None:
    area = "area(-27.603853,-48.5193,-27.602955,-48.5173)"
    views = [BeliefView(text=text) for text in (area, "area(1,2,3,4)", "area(3,2,1,4)", "area(x,y,1,2)", "area(5)")]
    fleet = rescue().mind("scout").mind("rescuer1")
    fleet.model.agents["scout"].believed = tuple(views)
    fleet.model.agents["rescuer1"].believed = tuple(views[:1])
    told = marks(fleet.model)
    assert [one.bounds for one in told.areas] == [(-27.603853, -48.5193, -27.602955, -48.5173)]


def test_beliefs_that_are_no_places_make_no_marks() -> None:
    texts = (
        "victim(7)",
        "victim(7,north,south)",
        "victim(7,1e999,3)",
        "~victim(7,1,2)",
        "a :- b",
        "((",
        "x",
        "victim(7,91,0)",
    )
    assert not by_id(rescue(), scout=texts)
    assert literal("((" * 5_000) is None


def test_marks_are_bounded_and_the_rest_is_counted() -> None:
    fleet = rescue()
    for number in range(400):
        fleet.percept("scout", "victim", number, *VICTIM, key=(0,))
    told = marks(fleet.model)
    assert len(told.marks) == 300
    assert told.left_out == 100
