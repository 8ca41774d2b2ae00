"""Small belief bases with rules, and queries about them: texts made by a given way of choosing."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

Pick = Callable[[Sequence[Any]], Any]
"""Chooses one of several things."""

LISTS = """
append([], L, L).
append([H|T], L, [H|R]) :- append(T, L, R).
mem(X, [X|_]).
mem(X, [_|T]) :- mem(X, T).
len([], 0).
len([_|T], N+1) :- len(T, N).
total([], 0).
total([H|T], H+S) :- total(T, S).
rev([], A, A).
rev([H|T], A, R) :- rev(T, [H|A], R).
drop(X, [X|T], T).
drop(X, [H|T], [H|R]) :- drop(X, T, R).
"""
"""Recursive rules over lists that generated rules and queries may ask."""

_LIST_CALLS = ("append", "mem", "len", "total", "rev", "drop")
_ARITY = {"append": 3, "mem": 2, "len": 2, "total": 2, "rev": 3, "drop": 3}
_CONSTANTS = ("1", "2", "a", "b", '"s"', "[]", "f(1)", "f(a)", "[1]", "[1,2]", "[a,1]", "g(1,a)", "f(f(1))")
_RELATIONS = ("==", "\\==", "<", "<=", ">", ">=", "=", "=", "=")


class Case(NamedTuple):
    """A program of beliefs and rules, a query with what is known before it, and the variables to show."""

    program: str
    known: str
    query: str
    shown: str


class Call(NamedTuple):
    """Beliefs and rules, the heads and contexts of plans for ``g/2``, and a call with what is known before it."""

    program: str
    plans: tuple[tuple[str, str], ...]
    known: str
    call: str
    shown: str


class Generator:
    """Makes one case."""

    def __init__(self, pick: Pick) -> None:
        self.pick = pick
        self._predicates: list[tuple[str, int]] = []

    def case(self) -> Case:
        program = [self._facts("p", 1), self._facts("q", 2), self._facts("r", 2)]
        self._predicates = [("p", 1), ("q", 2), ("r", 2), ("r", 2)]
        for name, arity in (("s", 1), ("t", 2), ("u", 2), ("w", 3)):
            if self.pick((True, True, False)):
                program.append(self._rules(name, arity))
                self._predicates += [(name, arity)] * 2
        names = ("X", "Y", "Z")
        known = [f"{name} = {self.term(('X', 'Y', 'Z', 'W'), 1)}" for name in names if self.pick((True, False, False))]
        query = self.formula((*names, *names, "W"), self.pick((1, 2, 2, 3)))
        return Case("\n".join(program) + LISTS, " & ".join(["true", *known]), query, "k(X,Y,Z)")

    def call(self) -> Call:
        program = [self._facts("p", 1), self._facts("q", 2), self._facts("r", 2)]
        self._predicates = [("p", 1), ("q", 2), ("r", 2)]
        program.append(self._rules("t", 2))
        self._predicates += [("t", 2)] * 2
        inner, outer = ("A", "B", "C"), ("X", "Y", "Z")
        plans = tuple(
            (f"g({self.head_term(inner)},{self.head_term(inner)})", self.formula(inner, self.pick((0, 1))))
            for _ in range(self.pick((1, 2, 3)))
        )
        known = [f"{name} = {self.term((*outer, 'W'), 1)}" for name in outer if self.pick((True, False))]
        call = f"g({self.argument(outer)},{self.argument(outer)})"
        return Call("\n".join(program) + LISTS, plans, " & ".join(["true", *known]), call, "k(X,Y,Z)")

    def _facts(self, name: str, arity: int) -> str:
        facts = dict.fromkeys(f"{name}({self._constants(arity)})" for _ in range(self.pick((1, 2, 3, 4, 9))))
        lines = [fact + self.pick(("", "", "[m(1)]", "[m(1),m(2)]")) + "." for fact in facts]
        return "\n".join(lines)

    def _constants(self, count: int) -> str:
        return ",".join(self.pick(_CONSTANTS) for _ in range(count))

    def _rules(self, name: str, arity: int) -> str:
        rules = []
        for _ in range(self.pick((1, 1, 2))):
            names = ("A", "B", "C")
            head = ",".join(self.head_term(names) for _ in range(arity))
            rules.append(f"{name}({head}) :- {self.formula(names, 2)}.")
        if self.pick((False, False, True)):
            rules.insert(self.pick((0, 1)), f"{name}({self._constants(arity)}).")
        return "\n".join(rules)

    def head_term(self, names: Sequence[str]) -> str:
        if self.pick((True, True, True, False)):
            return self.term(names, 1)
        return f"{self.pick(names)}+{self.pick((1, 2))}"

    def term(self, names: Sequence[str], depth: int) -> str:
        kinds: tuple[str, ...] = ("variable", "variable", "constant", "anonymous")
        kind = self.pick((*kinds, "f", "g", "list", "open") if depth else kinds)
        if kind == "variable":
            return str(self.pick(names))
        if kind == "constant":
            return str(self.pick(_CONSTANTS))
        if kind == "anonymous":
            return "_"
        if kind == "f":
            return f"f({self.term(names, depth - 1)})"
        first, second = self.term(names, depth - 1), self.term(names, depth - 1)
        if kind == "g":
            return f"g({first},{second})"
        return f"[{first},{second}]" if kind == "list" else f"[{first}|{self.pick((*names, '_'))}]"

    def argument(self, names: Sequence[str]) -> str:
        if self.pick((True,) * 7 + (False,)):
            return self.term(names, 2)
        return f"{self.pick(names)}{self.pick(('+1', '*2', '-1'))}"

    def formula(self, names: Sequence[str], depth: int) -> str:
        kinds: tuple[str, ...] = ("query", "query", "query", "relation", "member", "list")
        if depth:
            kinds += ("and", "and", "and", "or", "not", "findall", "count")
        match self.pick(kinds):
            case "query":
                name, arity = self.pick(self._predicates)
                annotation = self.pick(("", "", "", "", f"[m({self.pick((*names, '1', '_'))})]"))
                return f"{name}({','.join(self.argument(names) for _ in range(arity))}){annotation}"
            case "relation":
                return f"{self.argument(names)} {self.pick(_RELATIONS)} {self.argument(names)}"
            case "member":
                return f".member({self.term(names, 1)}, {self.pick(('[1,2,f(1)]', '[a,f(b),[1]]', *names))})"
            case "list":
                name = self.pick(_LIST_CALLS)
                closed = self.pick(("[1,2]", "[2,1]", "[a,1,b]", "[]", f"[1,{self.pick(names)}]", self.pick(names)))
                first = closed if name not in ("mem", "drop") else self.term(names, 1)
                others = [closed if name in ("mem", "drop") else self.argument(names)]
                others += [self.argument(names)] if _ARITY[name] == 3 else []
                return f"{name}({','.join([first, *others])})"
            case "and":
                return f"{self.formula(names, depth - 1)} & {self.formula(names, depth - 1)}"
            case "or":
                return f"({self.formula(names, depth - 1)} | {self.formula(names, depth - 1)})"
            case "not":
                return f"not ({self.formula(names, depth - 1)})"
            case "findall":
                shown, inner = self.term((*names, "V"), 1), self.formula((*names, "V"), depth - 1)
                return f".findall({shown}, {inner}, {self.term(names, 1)})"
        return f".count({self.formula((*names, 'V'), depth - 1)}, {self.pick(names)})"
