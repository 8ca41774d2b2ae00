"""Every internal action and function of Jason 3.3's standard library is there."""

import pytest

from agentd.mind.data.registry import FUNCTIONS, Library, find_action
from tests.agentd.minds import World, mind_of

ACTIONS = {
    "printing": ".print .println .printf/2 .puts/1 .log/1 .print_unifier/0 .list_plans .list_rules .verbose/1",
    "strings": ".concat/3 .length/2 .substring/3 .replace/4 .lower_case/2 .upper_case/2 .term2string/2",
    "lists": ".member/2 .nth/3 .delete/3 .sort/2 .shuffle/2 .min/2 .max/3 .union/3 .intersection/3 .difference/3 "
    ".prefix/2 .suffix/2 .sublist/2 .range/3 .random/1 .set_random_seed/1 .findall/3 .setof/3 .count/2 .eval/2 "
    ".reverse/2 .empty/1",
    "kinds": ".atom/1 .number/1 .string/1 .list/1 .literal/1 .structure/1 .ground/1 .internal_action/1 .type/2 "
    ".copy_term/2 .rename_apart/2 .add_annot/3 .add_nested_source/3 .remove_source_annot/2",
    "beliefs": ".abolish/1 .asserta/1 .assertz/1 .belief/1 .relevant_rules/2 .namespace/1 .namespace_set_prop/3 "
    ".namespace_get_prop/3 .include/1 .save_agent/1 .perceive",
    "plans": ".add_plan/1 .remove_plan/1 .relevant_plans/2 .relevant_plan/2 .plan_label/2",
    "goals": ".desire/1 .intend/1 .intention/2 .current_intention/1 .drop_intention .drop_desire/1 .drop_event/1 "
    ".drop_all_intentions .drop_all_events .drop_all_desires .drop_future_intention/1 .succeed_goal/1 .fail_goal/1 "
    ".done .fail .suspend .resume/1 .suspended/2 .signal/1 .at/2 .wait/1 .join",
    "time and names": ".date/3 .time/3 .nano_time/1 .my_name/1 .all_names/1 .version/1 .stopMAS .kill_agent/1 "
    ".clone/1 .create_agent/2 .df_register/1 .df_deregister/1 .df_search/2 .df_subscribe/1",
    "messages": ".send/3 .broadcast/2",
    "maps": ".map.create/1 .map.put/3 .map.get/3 .map.remove/3 .map.key/2 .map.value/2 .map.clear/1 .map.copy/2",
    "sets": ".set.create/1 .set.add/2 .set.add_all/2 .set.remove/2 .set.union/2 .set.intersection/2 .set.difference/2 "
    ".set.clear/1 .set.copy/2 .set.to_list/2",
    "queues": ".queue.create/1 .queue.add/2 .queue.add_all/2 .queue.head/2 .queue.remove/2 .queue.to_list/2 "
    ".queue.clear/1 .queue.copy/2",
}
"""The names, with the least number of arguments where that is not none."""

OF_NUMBERS = "abs round floor ceil sqrt log sin cos tan asin acos atan"
OF_LISTS = "sum average mean median std_dev max min"


@pytest.mark.parametrize("group", ACTIONS)
def test_an_internal_action_is_there_with_so_many_arguments(group: str) -> None:
    for entry in ACTIONS[group].split():
        name, _, arity = entry.partition("/")
        found = find_action(name, int(arity or 0))
        assert found is not None, name
        assert found.function.__name__ != "wrong", f"{name} does not take {arity or 0} arguments"


def test_a_function_is_there() -> None:
    names = [(f"math.{name}", 1) for name in f"{OF_NUMBERS} {OF_LISTS} random".split()]
    names += [("math.max", 2), ("math.min", 2), ("math.pi", 0), ("math.e", 0), ("math.random", 0), ("system.time", 0)]
    assert set(names) | {(".length", 1)} <= set(FUNCTIONS)
    assert Library().is_function("math.abs", 1)


def test_control_can_be_written_as_internal_actions() -> None:
    world = World(
        mind_of("""
        n(0). !go.
        +!go
           <- .foreach(.member(X, [a,b]), { .print(X) }); .loop(n(N) & N < 2, { -+n(N+1); .print(N) });
              .if_then_else(n(2), { .print(yes) }, { .print(no) }); .if_then_else(n(7), { .print(no) });
              .fork(and, { .print(one) }, { .print(two) }); .fork(or, { .wait(never) }, { .print(first) }); .print(end).
        """)
    )
    assert world.settle().prints == ["a", "b", "0", "1", "yes", "one", "two", "first", "end"]
