"""Packages that provide internal actions and functions: found by entry points, used, and reported when broken."""

import os
import subprocess
import tomllib
from pathlib import Path

import pytest

from tests.agentd.conftest import Command, agentd

COMPASS = Path(__file__).parents[3] / "examples" / "compass"


def _install(site: Path, name: str, version: str, entries: dict[str, str]) -> None:
    """What an installer leaves of a package's metadata."""
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    lines = "".join(f"{key} = {value}\n" for key, value in entries.items())
    (info / "entry_points.txt").write_text(f"[argosy.internal_actions]\n{lines}")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    return folder


@pytest.fixture
def with_site(site: Path):
    """Run a command in a process that finds what is in the site."""

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        return agentd(*arguments, env={**os.environ, "PYTHONPATH": str(site)})

    return run


@pytest.fixture
def ran(mylib: Path, with_site, tmp_path: Path):
    """Run a program beside the packages."""

    def run(text: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "bob.asl").write_text(text)
        return with_site("run", "--exit-when-idle", tmp_path / "bob.asl")

    return run


def test_the_example_package_is_found_by_its_entry_point_and_its_program_runs(site: Path, with_site) -> None:
    project = tomllib.loads((COMPASS / "pyproject.toml").read_text())["project"]
    (site / "compass_for_agents.py").write_text((COMPASS / "compass_for_agents.py").read_text())
    _install(site, project["name"], project["version"], project["entry-points"]["argosy.internal_actions"])
    done = with_site("run", COMPASS / "walker.asl", "--exit-when-idle")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "[walker] going north, 32 degrees off\n[walker] [north,east]\n"


MYLIB = """
from agentd import function, internal_action, unify

@internal_action("mylib.is_even", 1)
def is_even(mind, trail, number):
    return number % 2 == 0

@internal_action("mylib.broken", 1)
def broken(mind, trail, what):
    return what.nonsense

@function("mylib.twice", 1)
def twice(mind, number):
    return 2 * number

@function("mylib.parts", 1)
def parts(mind, text):
    return [len(text), True, *text.split()]

@internal_action("mylib.same", 2)
def same(mind, trail, index, found):
    return unify(found, [3, "three", {3}, True][int(index)], trail)

@internal_action(".print", 1)
def silence(mind, trail, text):
    return True
"""


@pytest.fixture
def mylib(site: Path) -> Path:
    (site / "my_module.py").write_text(MYLIB)
    _install(site, "my-package", "2.3", {"mylib": "my_module", "sick": "no_such_module", "hurt": "my_hurt"})
    (site / "my_hurt.py").write_text("answer = 1 / 0\n")
    return site


def test_actions_and_functions_serve_in_bodies_contexts_rules_facts_and_registered_functions(ran) -> None:
    done = ran(
        """
        size(mylib.twice(3)).
        even(X) :- .member(X, [1,2,3,4]) & mylib.is_even(X).
        !s.
        +!s : mylib.is_even(2) & not mylib.is_even(3) & size(S)
          <- .print(S); .findall(X, even(X), L); .print(L); .print(mylib.twice(4) + 1);
             if (mylib.is_even(4)) { mylib.is_even(3) }.
        -!s[error(E)] <- .print(E).
        """
    )
    assert (done.stderr, done.returncode) == ("", 0)
    assert done.stdout.splitlines() == ["[bob] 6", "[bob] [2,4]", "[bob] 9", "[bob] ia_failed"]


def test_python_values_that_a_package_unifies_or_returns_are_terms(ran) -> None:
    done = ran(
        """
        !s.
        +!s <- [N,B|Words] = mylib.parts("a bc"); B == true; mylib.same(0, M); X = N + M; .print(X, Words);
               mylib.same(1, S); .length(S, L); mylib.same(3, default::T); .print(L, T); mylib.same(2, _).
        -!s[error_msg(Why)] <- .print(Why).
        """
    )
    assert done.stdout.startswith(
        '[bob] 7["a","bc"]\n[bob] 5true\n[bob] PluginError: mylib.same: TypeError: {3} cannot be'
    )
    assert done.stderr == ""


def test_what_a_package_does_not_provide_or_not_with_so_many_arguments_fails(ran) -> None:
    done = ran(
        """
        !a. !b. !c.
        +!a <- mylib.nosuch(1).      -!a[error(E)] <- .print(a, E).
        +!b <- mylib.is_even(1, 2).  -!b[error(E), error_msg(M)] <- .print(b, E, M).
        +!c <- other.thing(1).       -!c[error(E)] <- .print(c, E).
        """
    )
    assert sorted(done.stdout.splitlines()) == [
        "[bob] aaction_failed",
        "[bob] bwrong_argumentsmylib.is_even does not take 2 arguments",
        "[bob] caction_failed",
    ]


def test_an_error_in_a_package_is_reported_with_its_action_file_and_line(ran, mylib: Path) -> None:
    done = ran(
        """
        !a. !b.
        +!a <- mylib.broken(1).  -!a[error_msg(M)] <- .print(M).
        +!b : mylib.broken(1) <- true.
        """
    )
    where = f"({mylib}/my_module.py:10, in broken)"
    text = f"PluginError: mylib.broken: AttributeError: 'float' object has no attribute 'nonsense' {where}"
    assert done.stdout == f"[bob] {text}\n"
    assert f"[bob] warning: an internal action in a condition went wrong: {text}" in done.stderr


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("sick", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("hurt", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_package_that_cannot_be_imported_is_named_where_it_is_used(ran, name: str, reason: str) -> None:
    done = ran(
        f"""
        !a. !b. !c.
        +!a <- {name}.act(1).     -!a[error_msg(M)] <- .print(M).
        +!b : {name}.know(1) <- true.
        +!c <- X = {name}.f(1).   -!c[error_msg(M)] <- .print(M).
        """
    )
    warning = f"the plug-in {name} of my-package 2.3 cannot be loaded: {reason}"
    assert done.stdout.count(warning) == 2
    assert warning in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("mylib")
def test_a_check_of_a_program_knows_the_packages_that_are_installed(with_site, tmp_path: Path) -> None:
    program = tmp_path / "bob.asl"
    program.write_text("!s.\n+!s <- mylib.is_even(2);\n mylib.is_evn(2);\n hurt.act(1).")
    done = with_site("check", program)
    first, second = [line.partition("bob.asl:")[2] for line in done.stderr.splitlines() if "bob.asl" in line]
    assert first.startswith("3:2: error: there is no function or internal action mylib.is_evn/1")
    assert first.endswith("did you mean `mylib.is_even`?")
    assert second.startswith(
        "4:2: error: hurt.act/1 cannot be used: the plug-in hurt of my-package 2.3 cannot be loaded"
    )
    assert done.returncode == 1


def test_a_package_cannot_replace_the_standard_library(ran) -> None:
    done = ran("!s. +!s <- mylib.is_even(2); .print(heard).")
    assert done.stdout == "[bob] heard\n"


def test_programs_that_name_no_packages_do_not_look_for_any(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def looked(**_: object) -> None:
        raise AssertionError("entry points were looked for")

    monkeypatch.setattr("importlib.metadata.entry_points", looked)
    program = "!s. +!s : .my_name(N) <- X = math.abs(-1); .print(X)."
    assert command({"bob.asl": program}, "run", "--exit-when-idle", "bob.asl").lines == ["[bob] 1"]
