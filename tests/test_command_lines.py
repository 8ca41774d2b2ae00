"""Commands that are misspelt: each program says which one was meant."""

import sys
from collections.abc import Callable
from importlib.abc import MetaPathFinder

import pytest

from agentd.__main__ import main as agentd
from argosy import command
from argosy.__main__ import main as argosy
from bridged.__main__ import main as bridged
from commd.__main__ import main as commd


@pytest.mark.parametrize(
    ("program", "given", "told"),
    [
        (argosy, ["chek", "m.yaml"], "argosy: error: there is no command `chek`, did you mean `check`?"),
        (argosy, ["stat"], "argosy: error: there is no command `stat`, did you mean `status`?"),
        (argosy, ["manifest", "chekc"], "argosy manifest: error: there is no command `chekc`, did you mean `check`?"),
        (agentd, ["serv", "m.yaml"], "agentd: error: there is no command `serv`, did you mean `serve`?"),
        (bridged, ["simulat"], "bridged: error: there is no command `simulat`, did you mean `simulate`?"),
        (bridged, ["zzz"], "bridged: error: there is no command `zzz`; known are serve, simulate"),
        (commd, ["server", "m.yaml"], "commd: error: there is no command `server`, did you mean `serve`?"),
        (argosy, ["run", "m.yaml", "--repot=x"], "unrecognized arguments: --repot=x, did you mean `--report`?"),
        (argosy, ["run", "m.yaml", "other.yaml"], "unrecognized arguments: other.yaml\n".rstrip()),
        (agentd, ["test", "f", "--juint", "x"], "unrecognized arguments: --juint x, did you mean `--junit`?"),
        (commd, ["serve", "m.yaml", "--bord", "pi1"], "unrecognized arguments: --bord pi1, did you mean `--board`?"),
    ],
)
def test_a_misspelt_command_or_option_is_told_with_the_one_that_was_meant(
    program: Callable[[list[str]], int], given: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        program(given)
    assert ended.value.code == 2
    assert told in capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize("speed", ["nan", "0", "-1", "inf", "101"])
@pytest.mark.parametrize(
    ("program", "command"), [(argosy, "run"), (argosy, "simulate"), (agentd, "serve"), (bridged, "serve")]
)
def test_a_speed_that_none_can_keep_is_refused(
    program: Callable[[list[str]], int], command: str, speed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        program([command, "m.yaml", f"--speed={speed}"])
    assert ended.value.code == 2
    assert f"argument --speed: expected a speed above 0, at most 100, got `{speed}`" in capsys.readouterr().err


@pytest.mark.parametrize("program", [argosy, agentd, bridged, commd])
def test_no_command_tells_the_usage(program: Callable[[list[str]], int], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        program([])
    assert ended.value.code == 2
    assert "usage: " in capsys.readouterr().err


class Interrupted(MetaPathFinder):
    """Stands for ctrl-C in an import."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> None:
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("program", "given", "imported"),
    [
        (lambda _: command(), [], "argosy.__main__"),
        (agentd, ["check", "bob.asl"], "agentd.check.command"),
        (bridged, ["serve", "m.yaml"], "bridged.daemon"),
        (bridged, ["simulate", "copter"], "bridged.simulation.command"),
        (commd, ["serve", "m.yaml"], "commd.daemon"),
    ],
)
def test_ctrl_c_while_a_command_is_imported_ends_it_without_a_traceback(
    program: Callable[[list[str]], int], given: list[str], imported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    package, _, name = imported.rpartition(".")
    monkeypatch.delitem(sys.modules, imported, raising=False)
    monkeypatch.delattr(f"{package}.{name}", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupted()])
    with pytest.raises(SystemExit) as ended:
        program(given)
    assert ended.value.code == 130
