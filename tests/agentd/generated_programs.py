"""Random syntax trees that the parser can make, the programs of the corpus, and pieces of such."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias, TypeVar

from hypothesis import strategies as st
from msgspec.structs import replace

from agentd.language.parser.build_terms import NOT_IN_CONDITIONS
from agentd.language.syntax_tree.nodes import (
    And,
    Arithmetic,
    Belief,
    Body,
    BodyFormula,
    BodyTerm,
    For,
    Fork,
    Formula,
    Goal,
    If,
    InternalAction,
    Item,
    ListTerm,
    Not,
    Number,
    Operator,
    Or,
    Plan,
    PlanTerm,
    Program,
    Relation,
    Rule,
    RuleTerm,
    Step,
    String,
    Structure,
    Term,
    Trigger,
    TriggerTerm,
    Variable,
    While,
)

CORPUS = Path(__file__).parent.parent / "conformance"

_KEYWORDS = frozenset(("true", "false", "not", "div", "mod", "if", "elif", "else", "while", "for"))

names = st.from_regex(r"[a-z][a-zA-Z0-9_]{0,4}", fullmatch=True).filter(lambda name: name not in _KEYWORDS)
quoted = st.from_regex(r"'[ -&(-~]{0,5}'", fullmatch=True)
functors = names | quoted
variable_names = st.from_regex(r"[A-Z_][a-zA-Z0-9_]{0,3}", fullmatch=True)
internal_names = st.sampled_from((".print", ".map.put", ".length", "math.max", "my.own.action", ".nosuch"))
assert not NOT_IN_CONDITIONS & {".print", ".map.put", ".length", ".nosuch"}

numbers = st.builds(Number, st.floats(min_value=0.0, allow_nan=False, allow_infinity=True).map(abs))
texts = st.text(st.sampled_from('abc (){}[].;"\n%#é'), max_size=8) | st.sampled_from((r"\t", r"a\\b", r"\\n", '"'))
strings = st.builds(String, texts)
truths = st.sampled_from((Structure("true"), Structure("false")))


T = TypeVar("T")
_Maker: TypeAlias = Callable[[st.SearchStrategy[Term]], st.SearchStrategy[T]]


def _once(make: _Maker[T]) -> _Maker[T]:
    """Make a strategy once per strategy of terms, and name it shortly: hypothesis writes out what it is made of."""
    made: dict[st.SearchStrategy[Term], st.SearchStrategy[T]] = {}

    def find(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[T]:
        return made.setdefault(terms, st.deferred(lambda: make(terms)))

    return find


def _tuples(of: st.SearchStrategy[Term], most: int = 3) -> st.SearchStrategy[tuple[Term, ...]]:
    return st.lists(of, max_size=most).map(tuple)


def _tails(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Variable | ListTerm | None]:
    return st.none() | st.builds(Variable, variable_names) | st.builds(ListTerm, _tuples(terms, 2))


@_once
def _lists(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[ListTerm]:
    closed = st.builds(ListTerm, _tuples(terms))
    return closed | st.builds(ListTerm, st.lists(terms, min_size=1, max_size=3).map(tuple), _tails(terms))


@_once
def _annotations(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[ListTerm | None]:
    return st.none() | st.none() | _lists(terms) | st.builds(ListTerm, st.just(()), st.builds(Variable, variable_names))


namespaces = st.none() | st.none() | st.just("") | names | st.builds(Variable, variable_names)


@_once
def literals(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Structure]:
    return st.builds(Structure, functors, _tuples(terms), _annotations(terms), st.booleans(), namespaces)


@_once
def variables(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Variable]:
    return st.builds(Variable, variable_names, _annotations(terms), st.booleans(), namespaces)


plain_variables = st.builds(Variable, variable_names)
calls = st.builds(InternalAction, internal_names)


@_once
def _numeric(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Term]:
    base = numbers | plain_variables | calls
    binary = st.sampled_from(("+", "-", "*", "/", "**", "div", "mod"))
    grown = st.builds(lambda o, a, b: Arithmetic(o, (a, b)), binary, base, base)
    return grown | st.builds(lambda o, a: Arithmetic(o, (a,)), st.sampled_from("+-"), base | grown)


@_once
def formulas(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Formula]:
    relations = st.sampled_from(("<", "<=", ">", ">=", "==", "\\==", "=", "=.."))
    leaves: st.SearchStrategy[Formula] = (
        literals(terms)
        | variables(terms)
        | truths
        | st.builds(InternalAction, internal_names, _tuples(terms))
        | st.builds(Relation, relations, terms, terms)
    )
    grown = st.builds(And, leaves, leaves) | st.builds(Or, leaves, leaves) | st.builds(Not, leaves)
    return leaves | grown | st.builds(Not, grown) | st.builds(And, grown, grown) | st.builds(Or, grown, leaves)


@_once
def triggers(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Trigger]:
    targets = literals(terms) | variables(terms)
    goals = st.builds(Trigger, st.sampled_from("+-^"), st.sampled_from("!?"), targets)
    return goals | st.builds(Trigger, st.sampled_from("+-"), st.just(""), targets)


@_once
def _steps(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Step]:
    targets = literals(terms) | variables(terms)
    changes = (Operator.ADD, Operator.DELETE, Operator.UPDATE, Operator.ADD_FIRST, Operator.ADD_LAST)
    more_changes = (Operator.ADD_NEW_FOCUS, Operator.DELETE_NEW_FOCUS)
    code = st.builds(RuleTerm, st.builds(Rule, literals(terms), formulas(terms)))
    return (
        st.builds(Step, st.just(Operator.ACTION), formulas(terms))
        | st.builds(Step, st.sampled_from((Operator.ACHIEVE, Operator.ACHIEVE_NEW_FOCUS)), targets)
        | st.builds(Step, st.just(Operator.TEST), formulas(terms).map(_testable))
        | st.builds(Step, st.sampled_from(changes + more_changes), targets | code)
    )


@_once
def bodies(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Body]:
    """Bodies of at least one formula."""
    steps = _steps(terms)
    blocks = st.lists(steps, max_size=2).map(lambda formulas: Body(tuple(formulas)))
    branches = st.lists(st.tuples(formulas(terms), blocks), min_size=1, max_size=2).map(tuple)
    some: st.SearchStrategy[BodyFormula] = (
        steps
        | st.builds(If, branches, st.none() | blocks)
        | st.builds(While, formulas(terms), blocks)
        | st.builds(For, formulas(terms), blocks)
        | st.builds(Fork, st.sampled_from(("|&|", "|||")), st.lists(blocks, min_size=2, max_size=3).map(tuple))
    )
    return st.lists(some, min_size=1, max_size=3).map(lambda formulas: Body(tuple(formulas)))


@_once
def plans(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Plan]:
    conditions = st.none() | formulas(terms)
    labels = st.none() | literals(terms)
    contexts = conditions.map(lambda one: Structure("c") if one == Structure("true") else one)  # it reads back as none
    return st.builds(Plan, triggers(terms), contexts, bodies(terms) | st.just(Body()), labels, conditions)


@_once
def _code(terms: st.SearchStrategy[Term]) -> st.SearchStrategy[Term]:
    return (
        st.builds(PlanTerm, plans(terms).map(_more_than_a_trigger))
        | st.builds(RuleTerm, st.builds(Rule, literals(terms), formulas(terms)))
        | st.builds(TriggerTerm, triggers(terms))
        | st.builds(BodyTerm, bodies(terms).map(_no_trigger) | st.just(Body()))
    )


# What would read back as another kind of node is made a little longer. Filters would do, but hypothesis writes out what
# they filter, and that is megabytes here.


def _testable(formula: Formula) -> Formula:
    return Not(formula) if isinstance(formula, InternalAction) else formula


def _more_than_a_trigger(plan: Plan) -> Plan:
    if plan.label or plan.context or plan.goal_condition or plan.body.formulas:
        return plan
    return replace(plan, context=Structure("c"))


def _no_trigger(body: Body) -> Body:
    match body.formulas:
        case (Step(Operator.ADD | Operator.DELETE, Structure() | Variable()) as step,):
            return Body((step, step))
    return body


def _grow(inner: st.SearchStrategy[Term]) -> st.SearchStrategy[Term]:
    return (
        literals(inner)
        | variables(inner)
        | _lists(inner)
        | st.builds(InternalAction, internal_names, _tuples(inner))
        | _numeric(inner)
        | formulas(inner)
        | _code(inner)
    )


terms: st.SearchStrategy[Term] = st.recursive(
    numbers | strings | plain_variables | truths | st.builds(Structure, functors), _grow, max_leaves=12
)

_items: st.SearchStrategy[Item] = (
    st.builds(Belief, literals(terms))
    | st.builds(Rule, literals(terms), formulas(terms))
    | st.builds(Goal, literals(terms))
    | plans(terms)
    | st.builds(lambda plan, subs: Plan(plan.trigger, subplans=tuple(subs)), plans(terms), st.lists(plans(terms)))
)
programs = st.lists(_items, max_size=4).map(lambda items: Program("a.asl", tuple(items)))


# --- texts -----------------------------------------------------------------------------------------------------------

FRAGMENTS = (
    *"+-!?@^~.;:,|&<>=(){}[]\"'\\/*#$_ \n\t0a",
    *("+!", "-!", "<-", ":-", "<:", "|&|", "|||", "**", "=..", "\\==", "!=", "::", "-+", "++", "//", "/*", "*/", ".\n"),
    *("if", "elif", "else", "while", "for", "not", "div", "mod", "true", "begin", "end", "{ begin n }", "{ end }"),
    *(
        "b(1)",
        "X",
        "_",
        ".print",
        "math.pi",
        "f(",
        "1.",
        ".5",
        "1e",
        '"s"',
        '"',
        "'q'",
        "\n+!g <- a",
        "{ +!g }",
        "é",
        "\0",
    ),
)


@lru_cache(maxsize=1)
def corpus() -> tuple[str, ...]:
    return tuple(path.read_text(encoding="utf-8") for path in sorted(CORPUS.rglob("*.asl")))
