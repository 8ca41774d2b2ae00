"""Files that users name: what is told of one that is missing, or of another kind."""

from pathlib import Path

import pytest

from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.runtime.program_paths import SourcePaths
from argosy.recording.mcap_records import BadRecording, McapFile
from schemas.files.findings import Findings
from schemas.files.text_files import near_file
from schemas.manifest.loader import load_manifest
from schemas.mission.model import load_mission


def test_a_missing_file_is_told_with_the_one_that_it_nearly_is(tmp_path: Path) -> None:
    for name in ("single_uav.yaml", "uav.asl", "copter.toml", "a.asl"):
        (tmp_path / name).touch()
    (tmp_path / "uaw.asl").mkdir()
    assert near_file(tmp_path / "uaf.asl") == ", did you mean `uav.asl`?"
    assert [near_file(tmp_path / name) for name in ("uav.asl", "b.asl", "uav.txt", "none/uav.asl")] == [""] * 4
    with pytest.raises(Findings, match=r"No such file or directory, did you mean `single_uav[.]yaml`[?]$"):
        load_mission(tmp_path / "single_uaf.yaml")
    with pytest.raises(Findings, match=r", did you mean `copter[.]toml`[?]$"):
        load_manifest("coptre.toml", tmp_path)
    with pytest.raises(OSError, match=r"did you mean `uav[.]asl"):
        SourcePaths().find("uaf.asl", str(tmp_path / "single_uav.yaml"))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("copter.toml", "expected a mission in YAML; manifests are for `argosy manifest`"),
        ("flight.mcap", "expected a mission in YAML; recordings are for `argosy replay`"),
        ("uav.asl", "expected a mission in YAML; programs are for `agentd run` and `agentd check`"),
    ],
)
def test_a_file_of_another_kind_is_no_mission(name: str, told: str) -> None:
    with pytest.raises(Findings) as found:
        load_mission(name)
    assert found.value.findings[0].message == told


def test_a_mission_is_no_program_manifest_or_recording(tmp_path: Path) -> None:
    (file := tmp_path / "m.yaml").write_text("mission: m  # flies\n")
    with pytest.raises(SyntaxErrors, match=r"expected a program in AgentSpeak; missions are for `argosy run`"):
        parse_file(file)
    with pytest.raises(Findings, match=r"expected a manifest in TOML; missions are for `argosy run`"):
        load_manifest(str(file))
    with pytest.raises(BadRecording, match=r"not an MCAP file: missions are for `argosy run`"):
        McapFile(file)


def test_a_missing_recording_or_shipped_manifest_is_reported_with_the_one_that_it_nearly_is(tmp_path: Path) -> None:
    (tmp_path / "flight.mcap").touch()
    with pytest.raises(BadRecording, match=r"No such file or directory, did you mean `flight[.]mcap`[?]"):
        McapFile(tmp_path / "fligth.mcap")
    with pytest.raises(Findings, match=r"no such manifest, did you mean `copter`[?]"):
        load_manifest("coptre")
    with pytest.raises(Findings, match=r"no such manifest; expected a file or one of: copter, plane"):
        load_manifest("submarine")
