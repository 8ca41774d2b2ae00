"""No circles of imports: none at run time, and by types only where few files hold each other's types."""

from collections.abc import Iterable, Mapping
from typing import Final

import grimp

PACKAGES: Final = ("schemas", "commd", "bridged", "agentd", "argosy")
MOST_BY_TYPES: Final = 3
"""Files in a circle of imports for types: the state of a mind, its plans and its intentions hold each other."""


def circles(imports: Mapping[str, Iterable[str]]) -> set[frozenset[str]]:
    """The groups of modules that import each other, directly or by way of others."""
    reached = {module: _reached(module, imports) for module in imports}
    return {
        frozenset(other for other in behind if module in reached[other])
        for module, behind in reached.items()
        if module in behind
    }


def _reached(module: str, imports: Mapping[str, Iterable[str]]) -> set[str]:
    found: set[str] = set()
    pending = [module]
    while pending:
        new = set(imports[pending.pop()]) - found
        found |= new
        pending += new
    return found


def product(*, types: bool) -> set[frozenset[str]]:
    """The circles of the product; with ``types`` by way of imports under `TYPE_CHECKING`, too."""
    graph = grimp.build_graph(*PACKAGES, exclude_type_checking_imports=not types, cache_dir=None)
    return circles({module: graph.find_modules_directly_imported_by(module) for module in graph.modules})


def shown(found: Iterable[frozenset[str]]) -> str:
    return "; ".join(sorted(", ".join(sorted(circle)) for circle in found))


def test_circles_are_found() -> None:
    imports = {"a": ["b"], "b": ["c", "d"], "c": ["a"], "d": ["e"], "e": ["d"], "f": ["a"]}
    assert circles(imports) == {frozenset("abc"), frozenset("de")}


def test_no_modules_import_each_other_at_run_time() -> None:
    found = product(types=False)
    assert not found, shown(found)


def test_few_modules_import_each_other_for_types() -> None:
    found = {circle for circle in product(types=True) if len(circle) > MOST_BY_TYPES}
    assert not found, shown(found)
