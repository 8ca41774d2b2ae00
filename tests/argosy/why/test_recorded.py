"""`argosy why --recording`: a mind that lives again is asked as the running one is."""

import signal
from pathlib import Path
from unittest.mock import Mock

import pytest

from argosy.__main__ import main
from argosy.why.from_recording import _mind_at
from tests.argosy.why.asked import MISSION, eventually, timeless, told
from tests.argosy.why.test_must_show import page
from tests.support.processes import running


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A recording of the first program of the page, and what the running agent said."""
    from tests.support import ports

    folder = tmp_path_factory.mktemp("recorded")
    endpoint = f"tcp/127.0.0.1:{ports.free_port()}"
    program, _ = page("No plan could be chosen.")
    (folder / "uav.asl").write_text(f"{program}!later.\n+!later <- .wait(3000); !fly(home).\n")
    path, state = str(folder / "why.yaml"), ("--state", str(folder / "state"))
    Path(path).write_text(MISSION)
    file = folder / "why.mcap"
    with running("commd", "serve", path, *state, "--router", endpoint) as board:
        board.says("router board=")
        with running("argosy", "record", "--mission", path, "--router", endpoint, "-o", str(file)) as recorder:
            recorder.until(lambda _: file.exists(), "it records")
            with running("agentd", "serve", path, *state, "--router", endpoint) as agent:
                agent.says("no plan for +!fly(5) is applicable")
                said = eventually(lambda: told(endpoint, "uav", "fly"), lambda text: "land" in text)
                agent.signal(signal.SIGTERM)
                agent.ends()
            recorder.signal(signal.SIGTERM)
            recorder.ends()
    return file, said


def test_a_mind_of_a_recording_tells_the_same_as_the_running_one(
    recording: tuple[Path, str], capsys: pytest.CaptureFixture[str]
) -> None:
    file, said = recording
    assert main(["why", "uav", "fly", "--recording", str(file)]) == 0
    out, err = capsys.readouterr()
    assert (timeless(out), err) == (said, "")


def test_it_is_asked_as_it_was_at_a_moment(recording: tuple[Path, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["why", "uav", "fly", "--recording", str(recording[0]), "--at", "2"]) == 0
    _, [(_, said)] = page("No plan could be chosen.")
    assert timeless(capsys.readouterr().out) == said


@pytest.mark.parametrize(
    ("arguments", "code", "problem"),
    [
        (["uaw", "--recording", "FILE"], 1, "there are no inputs of uaw in it, did you mean `uav`?"),
        (["uav", "--recording", "none.mcap"], 2, "none.mcap"),
        (["uav", "--at", "3"], 2, "--at needs --recording FILE"),
    ],
)
def test_what_is_not_in_a_recording_is_said(
    recording: tuple[Path, str], arguments: list[str], code: int, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    told = [str(recording[0]) if one == "FILE" else one for one in arguments]
    assert main(["why", *told]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert problem in err


@pytest.mark.parametrize(("at", "place"), [(None, 2), (3.0, 1), (6.0, 2)])
def test_of_a_restarted_agent_the_start_that_is_asked_about_is_named(at: float | None, place: int) -> None:
    starts = (0.5, 5.0)
    minds = [Mock(batches=[Mock(initial=Mock(start=start))]) for start in starts]
    recording = Mock(**{"names_of.return_value": [("", "uav")], "minds.return_value": minds})
    assert _mind_at(recording, "uav", at) == (minds[place - 1], place, 2)
