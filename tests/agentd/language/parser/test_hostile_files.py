"""What a program or a user may name that is no file, leads out of the project, or grows without bound."""

import os
from pathlib import Path

import pytest

from agentd.language.parse import parse_file
from argosy.recording.mcap_records import BadRecording, McapFile
from schemas.files.findings import Findings
from schemas.files.text_files import read_bounded, read_text
from tests.agentd.conftest import agentd
from tests.agentd.teams import played

REFUSED = r"no regular file \(a pipe, socket or device\): name a file"


@pytest.mark.timeout(20)
def test_a_pipe_or_a_device_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.asl"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero")):
        with pytest.raises(OSError, match=REFUSED):
            parse_file(path)
        with pytest.raises(Findings, match=f"cannot be read: {REFUSED}"):
            read_text(path)
        with pytest.raises(BadRecording, match=REFUSED):
            McapFile(path)
    (tmp_path / "large.asl").write_bytes(b" " * 101)
    with pytest.raises(OSError, match="larger than 100 bytes"):
        read_bounded(tmp_path / "large.asl", 100)


def test_a_program_names_files_of_its_project_alone_unless_a_folder_is_allowed(tmp_path: Path) -> None:
    project, other = tmp_path / "project", tmp_path / "other"
    for folder in (project, other):
        folder.mkdir()
        (folder / "lib.asl").write_text(f"from({folder.name}).\n")
    (project / "link.asl").symlink_to(other / "lib.asl")
    (project / "out").symlink_to(other)
    (project / "bob.asl").write_text(
        '!a. !b. !c. !d. !e. +!a <- .include("lib.asl"); .print("a in").\n'
        '+!b <- .include("../other/lib.asl"); .print("b in").\n'
        '+!c <- .include("link.asl"); .print("c in"). +!d <- .save_agent("out/new.asl"); .print("d in").\n'
        '+!e <- .save_agent("new.asl"); .print("e in"). -!X[error_msg(M)] <- .print("refused ", X, " ", M).\n'
    )
    ran = agentd("run", "bob.asl", "--exit-when-idle", cwd=project)
    said = ran.stdout + ran.stderr
    assert "a in" in said, said
    assert "e in" in said
    assert not {"b in", "c in", "d in"} & set(said.replace("[bob] ", "").splitlines()), said
    assert said.count("allow it with --allow-folder FOLDER") == 3
    assert not (other / "new.asl").exists()
    ran = agentd("run", "bob.asl", "--exit-when-idle", "--allow-folder", other, cwd=project)
    assert {f"[bob] {name} in" for name in "abcde"} <= set(ran.stdout.splitlines()), ran.stderr


def test_a_formula_that_fails_names_a_long_list_by_its_length() -> None:
    """To copy and write a list of a million members took a minute."""
    program = """
        !d([0]). +!d(T) : .length(T) < 20000 <- .concat(T, T, U); !d(U). +!d(T) <- .nth(99999, T, _).
        -!d(_)[code(C)] <- .print(C); .stopMAS.
    """
    assert '"[...] (32768 members)"' in played({"bob": program})[0]


def test_a_name_that_no_file_can_have_fails_the_plan_that_saves_it(tmp_path: Path) -> None:
    program = f'!s. +!s <- .save_agent("{tmp_path}/a\0b"). -!s[error_msg(M)] <- .print(M).'
    assert played({"bob": program}) == [f"[bob] cannot write {tmp_path}/a\\x00b: embedded null byte"]
