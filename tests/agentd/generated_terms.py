"""Random run-time terms: ground ones, ones with variables, and pairs that may unify."""

from typing import Any

from hypothesis import strategies as st

from agentd.language.syntax_tree.signatures import DEFAULT, signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.terms import List, Literal, Var, elements, make_list
from tests.agentd.generated_programs import terms as syntax_terms

FEW_NAMES = ("a", "b", "c", "f", "g")
"""So few that many terms are alike."""

numbers = st.integers(-3, 3).map(float) | st.floats(allow_nan=False)
strings = st.text(st.sampled_from("ab \"\\\n'é"), max_size=3)
names = st.sampled_from((*FEW_NAMES, "'Quoted name'"))
namespaces = st.sampled_from((DEFAULT, DEFAULT, DEFAULT, "n", "m"))


def _literal(name: str, args: list[Any], annots: list[Any], negated: bool = False, namespace: str = DEFAULT) -> Literal:
    return Literal(signature(name, len(args), negated, namespace), tuple(args), sorted_annots(annots))


def _ground(inside: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    few = st.lists(inside, max_size=3)
    return few.map(make_list) | st.builds(_literal, names, few, few, st.booleans(), namespaces)


leaves = numbers | strings | st.builds(_literal, names, st.just([]), st.just([]))
ground: st.SearchStrategy[Any] = st.recursive(leaves, _ground, max_leaves=8)
"""Terms without variables."""

printable: st.SearchStrategy[Any] = st.recursive(
    st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.sampled_from("ab é,()"), max_size=3)
    | st.builds(_literal, names, st.just([]), st.just([])),
    _ground,
    max_leaves=8,
)
"""Ground terms whose text says all of them: ``.print`` escapes nothing in strings, and Infinity reads as a variable."""

any_terms = syntax_terms.map(lambda node: instantiate(node, {}))
"""Terms of every kind that a program can write: expressions, code, decorated variables too."""


def made_again(term: Any) -> Any:
    """An equal ground term of other objects."""
    match term:
        case Literal():
            return Literal(term.sig, tuple(map(made_again, term.args)), tuple(map(made_again, term.annots)))
        case List():
            return make_list([made_again(item) for item in elements(term)])
        case str():
            return "".join(list(term))
    return float(term)


_PLACES = (Var("X"), Var("Y"), Var("Z"))
"""Where variables stand in a term; each pair gets new ones in their place."""


def _plain(inside: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    few = st.lists(inside, max_size=2)
    open_ended = st.builds(make_list, few, st.sampled_from(_PLACES))
    return few.map(make_list) | open_ended | st.builds(_literal, names, few, st.just([]))


_small = st.sampled_from((0.0, 1.0, "s")) | st.sampled_from(_PLACES) | st.sampled_from(_PLACES)
_either = st.recursive(_small, _plain, max_leaves=6)


@st.composite
def plain_pairs(draw: st.DrawFn) -> tuple[Any, Any]:
    """Two terms over a few variables, without annotations and namespaces, alike enough to unify often."""
    left = draw(_either)
    right = draw(_either | st.just(left))
    new = {place: Var(place.name) for place in _PLACES}
    return _renewed(left, new), _renewed(right, new)


def _renewed(term: Any, new: dict[Var, Var]) -> Any:
    match term:
        case Var():
            return new[term]
        case Literal():
            return Literal(term.sig, tuple(_renewed(part, new) for part in term.args))
        case List() if term.items:
            return List(tuple(_renewed(item, new) for item in term.items), _renewed(term.tail, new))
    return term


def variables_of(term: Any) -> set[Var]:
    """The free variables of a plain term."""
    found: set[Var] = set()
    pending = [term]
    while pending:
        match pending.pop():
            case Var() as variable if variable.ref is None:
                found.add(variable)
            case Var() as variable:
                pending.append(variable.ref)
            case Literal() as literal:
                pending.extend(literal.args)
            case List() as found_list if found_list.items:
                pending += (*found_list.items[found_list.at :], found_list.tail)
    return found
