"""The wheel by itself: installed from a wheelhouse, without internet, far from the checkout, it does everything."""

import os
import platform
import subprocess
import sys
import venv
from collections.abc import Callable
from email.message import Message
from email.parser import HeaderParser
from pathlib import Path
from zipfile import ZipFile

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import canonicalize_name, parse_wheel_filename

from argosy.deploy.wheelhouse_command import EXTRAS, GLIBC, PYTHONS, own_wheel

ROOT = Path(__file__).parents[1]
PACKAGES = ("schemas", "commd", "bridged", "agentd", "argosy")
CARRIED = ("manifests", "missions", "deploy")
CONSTRAINTS = (ROOT / "deploy" / "constraints.txt").read_text().splitlines()
HERE = f"{sys.version_info.major}.{sys.version_info.minor}"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory, internet: None) -> Path:
    """Return the wheel of this checkout. Building it, as the wheelhouses of these tests, takes the internet."""
    return own_wheel(tmp_path_factory.mktemp("wheel"))


class Installed:
    """An empty virtual environment with nothing but what the wheelhouse gave, and a folder to work in."""

    def __init__(self, home: Path, work: Path) -> None:
        self.bin, self.work = home / "bin", work
        ours = ("PYTHON", "VIRTUAL_ENV", "ARGOSY")
        self._environment = {name: value for name, value in os.environ.items() if not name.startswith(ours)}

    def run(self, *command: str, within: float = 120) -> str:
        """Run one of its commands and return what it printed; it must succeed."""
        done = subprocess.run(
            [str(self.bin / command[0]), *command[1:]],
            cwd=self.work,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=within,
        )
        assert done.returncode == 0, f"{command}: exit {done.returncode}\n{done.stdout}{done.stderr}"
        return done.stdout

    def shipped(self, kind: str, name: str) -> Path:
        """Return where a shipped file was installed."""
        code = f"from schemas.files.shipped_files import shipped; print(shipped({kind!r}, {name!r}))"
        path = Path(self.run("python", "-c", code).strip())
        assert path.is_relative_to(self.bin.parent)
        return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """Install the wheel as docs/start/install.md has it on a board: from a wheelhouse, by the pip that is in there."""
    folder = tmp_path_factory.mktemp("installed")
    home, house, work = folder / "venv", folder / "wheelhouse", folder / "work"
    work.mkdir()
    here = ("--platform", platform.machine(), "--python", HERE, "--extras", "operator", "--wheel", str(wheel))
    said = argosy("wheelhouse", *here, "--out", str(house))
    venv.create(home, with_pip=False)
    recipe = next(line for line in said.splitlines() if "--no-index" in line).split()
    pip = str(folder / recipe[2])
    options = ["--python", str(home), "install", "--quiet", "--no-index", "--no-compile", "--find-links", str(house)]
    subprocess.run([sys.executable, pip, *options, "argosy[operator]"], check=True, timeout=120)
    return Installed(home, work)


def argosy(*arguments: str) -> str:
    """Run `argosy` of the checkout and return what it printed; it must succeed."""
    command = [sys.executable, "-m", "argosy", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_wheel_carries_each_file_of_the_packages_and_no_test(wheel: Path) -> None:
    there = {
        path.relative_to(ROOT).as_posix()
        for folder in (*PACKAGES, *CARRIED)
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    wanted = {f"schemas/shipped/{name}" if name.split("/")[0] in CARRIED else name for name in there}
    held = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert wanted - held == set()
    assert {name.split("/")[0] for name in held} == set(PACKAGES)


def test_the_installed_wheel_flies_a_mission(installed: Installed, endpoint: str, free_port: Callable[[], int]) -> None:
    shipped = installed.shipped("missions", "single_uav.yaml")
    text = shipped.read_text().replace(":14550", f":{free_port()}")
    mission = installed.work / "mine.yaml"
    mission.write_text(text.replace("program: single_uav/", f"program: {shipped.parent}/single_uav/"))
    said = installed.run("argosy", "run", "mine.yaml", "--speed", "5", "--router", endpoint)
    assert "return_to_launch" in said
    assert str(ROOT) not in said


def test_the_installed_wheel_checks_all_missions_that_ship_by_their_names(installed: Installed) -> None:
    names = sorted(path.stem for path in (ROOT / "missions").glob("[a-z]*.yaml"))
    said = installed.run("argosy", "check", *names)
    assert [line.split(": ")[:2] for line in said.splitlines()] == [[name, "ok"] for name in names]


def test_the_installed_wheel_converts_a_pair_of_manifests_and_checks_the_result(installed: Installed) -> None:
    pair = [str(installed.shipped("missions", f"paper_uav/{name}_manifest")) for name in ("actions", "perceptions")]
    (installed.work / "robot.toml").write_text(installed.run("argosy", "manifest", "convert", *pair))
    assert "ok" in installed.run("argosy", "manifest", "check", "robot.toml")


def test_the_installed_wheel_writes_the_units_of_a_board(installed: Installed) -> None:
    installed.run("argosy", "units", "single_uav", "--board", "local", "--out", "units")
    written = {path.name for path in (installed.work / "units").rglob("*") if path.is_file()}
    assert {"argosy-single-uav.target", "commd@.service", "bridged@.service", "agentd@.service"} <= written
    assert {"single_uav.yaml", "uav.asl", "router.json5", "INSTALL.md"} <= written


def test_the_installed_wheel_tests_a_program_by_the_assertions_that_it_carries(installed: Installed) -> None:
    (installed.work / "sums_test.asl").write_text("@sums[test] +!sums <- !assert_equals(3, 1 + 2).\n")
    assert "1 test: 1 passed" in installed.run("agentd", "test", "sums_test.asl")


def test_an_installation_makes_its_own_wheel_again_without_a_checkout(installed: Installed, wheel: Path) -> None:
    code = "from pathlib import Path; from argosy.deploy.wheelhouse_command import own_wheel; print(own_wheel(Path()))"
    again = installed.work / installed.run("python", "-c", code).strip()
    assert again.name == wheel.name
    ours, theirs = ZipFile(wheel), ZipFile(again)
    record = next(name for name in ours.namelist() if name.endswith("/RECORD"))
    assert set(theirs.namelist()) == set(ours.namelist())
    assert all(theirs.read(name) == ours.read(name) for name in ours.namelist() if name != record)
    assert sorted(theirs.read(record).splitlines()) == sorted(ours.read(record).splitlines())


def test_every_dependency_has_a_wheel_for_64_bit_raspberry_pi_os(wheel: Path, tmp_path: Path) -> None:
    argosy("wheelhouse", "--platform", "aarch64", "--wheel", str(wheel), "--out", str(tmp_path))
    for python in PYTHONS:
        assert _missing(tmp_path, "aarch64", python) == []
    tested = {canonicalize_name(line.split("==")[0]): line.split("==")[1] for line in CONSTRAINTS if "==" in line}
    held = {
        name: str(version) for name, version, *_ in (parse_wheel_filename(path.name) for path in tmp_path.iterdir())
    }
    assert held == {name: tested.get(name, version) for name, version in held.items()}
    assert held.keys() - tested.keys() == {"argosy", "pip"}


def _missing(house: Path, machine: str, python: str) -> list[str]:
    """Return what Argosy with all extras needs on a board, or what needs that, and the house has no wheel for."""
    platforms = [f"manylinux_2_{minor}_{machine}" for minor in reversed(GLIBC)] + [f"manylinux2014_{machine}"]
    version = tuple(map(int, python.split(".")))
    tags = {*cpython_tags(version, platforms=platforms), *compatible_tags(version, platforms=platforms)}
    board = {"python_version": python, "python_full_version": f"{python}.2", "platform_machine": machine}
    todo, seen, missing = [Requirement(f"argosy[{','.join(EXTRAS)}]")], set[str](), []
    while todo:
        wanted = todo.pop()
        if str(wanted) in seen:
            continue
        seen.add(str(wanted))
        found = _wheel_for(house, wanted, tags)
        if found is None:
            missing.append(str(wanted))
            continue
        for text in _metadata(found).get_all("Requires-Dist", []):
            needs = Requirement(text)
            if any(_holds(needs.marker, {**board, "extra": extra}) for extra in ("", *wanted.extras)):
                todo.append(needs)
    assert len(seen) > len(EXTRAS), "the wheel of Argosy says what it needs"
    return missing


def _wheel_for(house: Path, wanted: Requirement, tags: set[Tag]) -> Path | None:
    for path in house.glob("*.whl"):
        name, version, _, its = parse_wheel_filename(path.name)
        if name == canonicalize_name(wanted.name) and version in wanted.specifier and its & tags:
            return path
    return None


def _metadata(wheel: Path) -> Message:
    with ZipFile(wheel) as opened:
        name = next(name for name in opened.namelist() if name.endswith(".dist-info/METADATA"))
        return HeaderParser().parsestr(opened.read(name).decode())


def _holds(marker: Marker | None, board: dict[str, str]) -> bool:
    return marker is None or marker.evaluate(board)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--platform", "armv7l"), "`armv7l` is 32-bit: msgspec and PyYAML have no wheels"),
        (("--platform", "riscv"), "expected aarch64 or x86_64, got `riscv`"),
        (("--python", "2.7"), "expected versions such as 3.11,3.13"),
        (("--extras", "ui"), "there is no `ui`"),
        (("--wheel", "none.txt"), "expected a wheel of Argosy"),
        (("--wheel", "argosy-9-py3-none-any.whl"), "argosy-9-py3-none-any.whl: No such file"),
    ],
)
def test_an_impossible_wheelhouse_is_refused_in_words(tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    command = [sys.executable, "-m", "argosy", "wheelhouse", *arguments, "--out", str(tmp_path / "house")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode in (1, 2)
    assert told in done.stderr
    assert "Traceback" not in done.stderr


def test_without_internet_a_wheelhouse_says_where_one_is_made(tmp_path: Path, wheel: Path) -> None:
    command = [sys.executable, "-m", "argosy", "wheelhouse", "--wheel", str(wheel), "--out", str(tmp_path / "house")]
    nowhere = {f"{name}_PROXY": "http://127.0.0.1:1" for name in ("HTTP", "HTTPS", "ALL")}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, env={**os.environ, **nowhere, "NO_PROXY": ""}
    )
    assert done.returncode == 1
    assert "this machine must reach a package index" in done.stderr
    assert "ERROR: " in done.stderr.split("error: ")[0], "what pip itself reports"
