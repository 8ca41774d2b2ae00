"""What is wrong in the same way for every command: no router, no mission."""

import time
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.cli import operator_bus
from tests.support.promises import in_time

ASK = (
    *("act uav land", "echo", "hz", "list", "mail MISSION", "manifest get uav1", "record", "status MISSION"),
    *("status --mission MISSION", "mail --mission MISSION"),
    *("stop rtl", "why uav go"),
)
READ = (
    "check MISSION",
    "doctor MISSION",
    "doctor --mission MISSION",
    "mail MISSION",
    "stop rtl --mission MISSION",
    "ui --mission MISSION",
)


@pytest.mark.parametrize("command", ASK)
def test_without_a_router_it_fails_soon_and_says_where_it_looked(
    command: str, endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    if command != ASK[0]:  # one waits as long as all do
        monkeypatch.setattr(operator_bus, "ROUTER_PATIENCE", 0.3)
    (tmp_path / "m.yaml").write_text("mission: m\nagents: {a: {program: a.asl}}\n")
    began = time.monotonic()
    assert main([*command.replace("MISSION", "m.yaml").split(), "--router", endpoint]) == 1
    assert in_time(time.monotonic() - began, 15)
    out, err = capsys.readouterr()
    assert f"error: no router at {endpoint}" in err
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["m.yaml"]


@pytest.mark.parametrize("command", [*READ, "why uav --mission MISSION"])
def test_an_unreadable_mission_is_bad_input(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    none = str(tmp_path / "none.yaml")
    assert main(command.replace("MISSION", none).split()) == 2
    out, err = capsys.readouterr()
    assert err == f"{none}: error: cannot be read: No such file or directory\n"
    assert out == ""


@pytest.mark.parametrize("command", ["status", "mail", "doctor", "metrics"])
@pytest.mark.parametrize("given", [["a.yaml", "--mission", "b.yaml"], ["--mission", "a.yaml", "b.yaml"]])
def test_a_second_mission_is_refused(command: str, given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([command, *given])
    assert "yaml are two missions: name one" in capsys.readouterr().err


def test_the_doctor_needs_a_mission(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 2
    assert capsys.readouterr().err == "error: argosy doctor: expected a MISSION\n"
