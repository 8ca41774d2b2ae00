"""No example ships that nothing runs: each mission and each example has the test, or page, that runs it."""

import pytest

from tests.docs.pages import ROOT

RUN_IN = {
    "examples/camera": "tests/bridged/test_pages.py",
    "examples/client": "docs/guides/mail.md",
    "examples/compass": "tests/agentd/extensions/test_plugins.py",
    "examples/lamp": "tests/argosy/test_robots.py",
    "examples/sprayer": "docs/guides/my-robot.md",
    "missions/paper_turtle.yaml": "tests/bridged/simulation/turtle/test_turtle.py",
    "missions/paper_uav.yaml": "tests/argosy/trial/test_missions.py",
    "missions/search_and_rescue.yaml": "tests/boards/test_rescue.py",
    "missions/single_uav.yaml": "tests/argosy/run/test_mission_runner.py",
    "missions/relay.yaml": "tests/argosy/trial/test_missions.py",
    "missions/three_uavs.yaml": "tests/argosy/trial/test_missions.py",
    "missions/turtle.yaml": "tests/argosy/trial/test_missions.py",
}


def test_every_mission_and_example_is_in_the_table() -> None:
    shipped = [*(ROOT / "missions").glob("*.yaml"), *(path for path in (ROOT / "examples").iterdir() if path.is_dir())]
    assert {str(path.relative_to(ROOT)) for path in shipped} == set(RUN_IN)


@pytest.mark.parametrize("example", RUN_IN)
def test_what_runs_an_example_names_it(example: str) -> None:
    name = example.rpartition("/")[2].removesuffix(".yaml")
    assert name in (ROOT / RUN_IN[example]).read_text(encoding="utf-8")
