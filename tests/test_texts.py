"""One file has all texts of errors, refusals, notes and findings, to be read and reviewed together."""

from __future__ import annotations

from tests.support.texts import FILE, Module, all_texts, makers_of


def test_the_reviewed_file_has_the_texts_of_the_product() -> None:
    assert FILE.read_text(encoding="utf-8") == all_texts(), "after a review: python -m tests.support.texts"


def test_texts_are_found_where_they_are_made() -> None:
    source = """
def f(board, on):
    text = f"no board {board}" if on else "it is off now"
    raise Findings([Finding(path, 0, 0, text)])
def g(who):
    return Note("link_down", "the link is down: " + who, who)
def h(other):
    print(f"error: {other.name} does not answer")
    print("all is well")
    return Outcome(ok=False, reason=f"{other} is gone")
def i(robot, action):
    if action.order or (why := robot.lease.refuses(action)) and not _private():
        return Outcome("refused", _private() or why)
    return Execution(Outcome("failed", robot.with_more("it fell" if robot.low else robot.state)))
"""
    lease = """
def refuses(action) -> str:
    said = "held by another"
    return said if action.name else _private()
def _private() -> str | None:
    return "nobody holds it"
def listed() -> str:
    return "nothing that anybody asks for"
@property
def state(self) -> str:
    return f"in {self.mode} it fell"
"""
    other = """
def _private() -> str:
    return "another function of this name"
"""
    modules = [Module(text) for text in (source, lease, other)]
    makers = makers_of(modules)
    assert [list(module.texts(makers)) for module in modules[1:]] == [
        ["refuses returns: held by another", "_private returns: nobody holds it", "state returns: in {mode} it fell"],
        [],
    ]
    assert list(modules[0].texts(makers)) == [
        "Finding: no board {board}",
        "Finding: it is off now",
        "Note link_down: the link is down: {}",
        "print: error: {name} does not answer",
        "Outcome: {other} is gone",
        "Outcome failed: it fell",
    ]
