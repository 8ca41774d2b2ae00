"""The starts of the daemons are measured: each serves."""

from __future__ import annotations

from pathlib import Path

from benchmarks import results
from benchmarks.serving import KINDS, copied
from benchmarks import startup


def test_every_kind_of_process_is_started_and_serves() -> None:
    found = startup.measured(startup.WARM, 1)
    assert {one.name for one in found} == {one.name for one in KINDS}
    figures = startup.Figures(
        [startup.Start(one.name, state, one.seconds) for one in found for state in startup.STATES]
    )
    ratio = figures.ratio("agentd", startup.WARM)
    assert ratio > 1
    text = startup.blocks(results.here("make bench", 0.0), figures)["startup"]
    assert text.count(f"{figures.of('agentd', startup.WARM).median:.2f} s ({ratio:.1f})") == 2


def test_a_copy_of_the_code_has_byte_code_only_if_it_is_compiled(tmp_path: Path) -> None:
    compiled, plain = copied(tmp_path / "compiled", compiled=True), copied(tmp_path / "plain", compiled=False)
    assert list((compiled / "schemas").rglob("*.pyc"))
    assert not list(plain.rglob("*.pyc"))
