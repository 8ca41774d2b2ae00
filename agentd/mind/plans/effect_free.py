"""Which internal actions and functions are known to have no effect. What other packages provide is not known to."""

from __future__ import annotations

from typing import Final

WITHOUT_EFFECT: Final = frozenset(
    (
        ".all_names",
        ".atom",
        ".belief",
        ".concat",
        ".count",
        ".delete",
        ".desire",
        ".difference",
        ".empty",
        ".eval",
        ".findall",
        ".ground",
        ".intend",
        ".intention",
        ".internal_action",
        ".intersection",
        ".length",
        ".list",
        ".literal",
        ".lower_case",
        ".map.get",
        ".map.key",
        ".map.value",
        ".max",
        ".member",
        ".min",
        ".my_name",
        ".nth",
        ".number",
        ".plan_label",
        ".prefix",
        ".relevant_plan",
        ".relevant_plans",
        ".relevant_rules",
        ".replace",
        ".reverse",
        ".setof",
        ".sort",
        ".string",
        ".structure",
        ".sublist",
        ".substring",
        ".suffix",
        ".suspended",
        ".term2string",
        ".type",
        ".union",
        ".upper_case",
    )
)
"""Internal actions that only look: a context may be asked again with them. Any other may have an effect."""

IN_QUESTIONS: Final = (
    WITHOUT_EFFECT
    | {".add_annot", ".add_nested_source", ".copy_term", ".date", ".nano_time", ".range", ".remove_source_annot"}
    | {".rename_apart", ".set.to_list", ".queue.to_list", ".time", ".version"}
) - {".replace"}
"""Internal actions that a question of another agent may name: a regular expression can take for ever, hence not all."""

FUNCTIONS_IN_QUESTIONS: Final = frozenset(
    (
        ".length",
        "math.abs",
        "math.acos",
        "math.asin",
        "math.atan",
        "math.average",
        "math.ceil",
        "math.cos",
        "math.e",
        "math.floor",
        "math.log",
        "math.max",
        "math.mean",
        "math.median",
        "math.min",
        "math.pi",
        "math.round",
        "math.sin",
        "math.sqrt",
        "math.std_dev",
        "math.sum",
        "math.tan",
        "system.time",
    )
)
"""Functions that a question may name, besides those that the asked program registers itself."""
