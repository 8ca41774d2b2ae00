"""Hypothesis strategies for wire terms of every kind."""

from hypothesis import strategies as st

from schemas.wire.terms import Atom, Map, Number, OpenList, Queue, Set, Source, Structure, Variable

LETTERS = "abcxyzABCXYZ019_"
names = st.builds(str.__add__, st.sampled_from("abcxyz"), st.text(LETTERS, max_size=6)).filter(
    lambda name: name not in ("true", "false")
)
quoted = st.text('abc XY.,()"', max_size=6).map(lambda text: f"'{text}'")
atom_names = st.one_of(names, quoted)
variable_names = st.builds(str.__add__, st.sampled_from("ABXYZ_"), st.text(LETTERS, max_size=6))
namespaces = st.one_of(st.just(""), names)
sources = st.sampled_from(
    [
        Source("plan", "{ @l[a] +!g(X) : c & not d <- !a; +b }"),
        Source("plan", '{ +!g <- .print("}") }'),
        Source("rule", "{ h(X) :- b(X) & X > 1 }"),
        Source("trigger", "{ +!g }"),
        Source("body", "{ !a; +b; -c }"),
        Source("expression", "(X+1)"),
        Source("expression", "(a | not (b))"),
    ]
)
floats = st.floats(allow_nan=False, allow_infinity=False).map(lambda value: value + 0.0)
leaves = st.one_of(
    st.booleans(),
    st.integers(-(2**53), 2**53),
    floats,
    st.text(max_size=12),
    atom_names.map(Atom),
    st.sampled_from([Number("Infinity"), Number("-Infinity"), Number("NaN")]),
    variable_names.map(Variable),
    sources,
)


def _nested(inner: st.SearchStrategy[object]) -> st.SearchStrategy[object]:
    several = st.lists(inner, max_size=3).map(tuple)
    some = st.lists(inner, min_size=1, max_size=3).map(tuple)
    return st.one_of(
        st.lists(inner, max_size=3),
        st.builds(Structure, atom_names, some, several, st.booleans(), namespaces),
        st.builds(Variable, variable_names, several, st.booleans(), namespaces),
        st.builds(OpenList, some, variable_names.map(Variable)),
    )


def _collections(inner: st.SearchStrategy[object]) -> st.SearchStrategy[object]:
    several = st.lists(inner, max_size=3).map(tuple)
    pairs = st.lists(st.tuples(inner, inner), max_size=3).map(tuple)
    return st.one_of(st.builds(Map, pairs), st.builds(Set, several), st.builds(Queue, several, st.booleans()))


plain_terms = st.recursive(leaves, _nested, max_leaves=12)
"""Every kind of term that has a text of its own."""
terms = st.recursive(leaves, lambda inner: st.one_of(_nested(inner), _collections(inner)), max_leaves=12)
"""Every kind of term on the wire."""
