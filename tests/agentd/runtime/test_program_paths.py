"""Where the files of programs are looked for, and what a folder's name stands for."""

from pathlib import Path

import pytest

from agentd.language.compiler.compile import DirectiveError
from agentd.runtime.program_paths import SourcePaths, read_folders


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("near/main.asl", "near/both.asl", "lib/both.asl", "lib/far.asl", "src/agt/usual.asl", "jar/x/in.asl"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'from("{name}").\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_is_found_beside_the_one_that_names_it_then_in_the_folders_then_in_the_usual_places(tree: Path) -> None:
    paths = SourcePaths(folders=[Path("lib")])
    assert paths.find("both.asl", "near/main.asl") == "near/both.asl"
    assert paths.find("both.asl", "") == "lib/both.asl"
    assert paths.find("far.asl", "near/main.asl") == "lib/far.asl"
    assert paths.find("usual.asl", "near/main.asl") == "src/agt/usual.asl"
    assert paths.find(str(tree / "lib/far.asl"), "near/main.asl") == str(tree / "lib/far.asl")


def test_a_file_that_is_nowhere_is_reported_with_where_it_was_looked_for(tree: Path) -> None:
    with pytest.raises(FileNotFoundError) as told:
        SourcePaths(folders=[Path("lib")]).find("gone.asl", "near/main.asl")
    assert told.value.strerror == "No such file or directory (looked in near, lib, ., src/agt)"


@pytest.mark.parametrize("argument", ["jasonJar=jar", "$jasonJar=jar", "$jasonJar/=jar"])
def test_a_name_stands_for_its_folder(tree: Path, argument: str) -> None:
    assert read_folders([argument], SourcePaths).find("$jasonJar/x/in.asl", "near/main.asl") == "jar/x/in.asl"


def test_a_name_that_stands_for_nothing_is_an_error_that_says_how_to_give_it(tree: Path) -> None:
    (tree / "main.asl").write_text('!a.\n{ include("$jasonJar/x/in.asl") }\n')
    with pytest.raises(DirectiveError) as told:
        SourcePaths().compiled("main.asl")
    assert str(told.value) == (
        'main.asl:2:1: error: cannot include "$jasonJar/x/in.asl": '
        "nothing says which folder $jasonJar is; give --map '$jasonJar=FOLDER'"
    )


def test_a_folder_that_is_not_there_is_refused(tree: Path) -> None:
    with pytest.raises(ValueError, match="there is no folder nowhere"):
        read_folders(["$jasonJar=nowhere"], SourcePaths)
    with pytest.raises(ValueError, match=r"there is no folder \(empty\)"):
        read_folders(["jasonJar="], SourcePaths)


def test_includes_of_included_files_use_the_same_names(tree: Path) -> None:
    (tree / "jar/x/in.asl").write_text('{ include("deep.asl") }\n')
    (tree / "jar/x/deep.asl").write_text('{ include("$jasonJar/x/leaf.asl") }\n')
    (tree / "jar/x/leaf.asl").write_text("leaf.\n")
    (tree / "main.asl").write_text('{ include("$jasonJar/x/in.asl") }\n')
    program = read_folders(["$jasonJar=jar"], SourcePaths).compiled("main.asl")
    assert [belief.position.file for belief in program.beliefs] == ["jar/x/leaf.asl"]


def test_a_search_for_files_that_would_take_for_ever_is_refused(tree: Path) -> None:
    (tree / f"{'a' * 50}b").touch()
    with pytest.raises(ValueError, match="takes more than 1 s"):
        SourcePaths().files_below(".", "", "(a+)+$")
