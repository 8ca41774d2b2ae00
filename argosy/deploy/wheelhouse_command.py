"""`argosy wheelhouse`: download all wheels that boards without internet need into a folder."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from importlib.metadata import Distribution, distribution
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote, urlsplit
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile

from argosy.cli.errors import BadInput, CommandError
from commd.process.process import EXIT_DONE

PLATFORMS = ("aarch64", "x86_64")
PYTHONS = ("3.11", "3.13")
"""Versions of 64-bit Raspberry Pi OS: bookworm and trixie."""
GLIBC = range(17, 37)
"""Supported minor versions of glibc 2: bookworm has 2.36."""
EXTRAS = ("operator", "keys")
"""Optional parts that are useful on a board."""
PATIENCE = 900.0
"""Wall seconds for one run of pip: a build, or the downloads for one Python."""
_OF_THIS_MACHINE = frozenset({"INSTALLER", "REQUESTED", "RECORD", "direct_url.json"})
"""Metadata files that an installer adds."""


class NoWheel(CommandError):
    """A wheel cannot be built or downloaded; the text says why."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy wheelhouse`."""
    parser.add_argument(
        "--platform",
        type=_platform,
        default="aarch64",
        help=f"processor of the boards: {' or '.join(PLATFORMS)} (default: aarch64)",
    )
    parser.add_argument(
        "--python",
        type=_versions,
        default=PYTHONS,
        metavar="X.Y[,X.Y]",
        help=f"Python versions of the boards (default: {','.join(PYTHONS)})",
    )
    parser.add_argument(
        "--extras",
        type=_extras,
        default=EXTRAS,
        metavar="NAMES",
        help=f"optional parts, separated by commas, or `none` (default: {','.join(EXTRAS)})",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("wheelhouse"), metavar="DIR", help="folder to fill (default: wheelhouse)"
    )
    parser.add_argument(
        "--wheel", type=Path, metavar="FILE", help="wheel of Argosy (default: packed from this installation)"
    )


def run(args: Namespace) -> int:
    """Fill the folder. Raises NoWheel when a wheel is not available, BadInput if the folder cannot be written."""
    try:
        out: Path = args.out
        out.mkdir(parents=True, exist_ok=True)
        wheel = _given(args.wheel, out) if args.wheel is not None else own_wheel(out)
        with TemporaryDirectory() as folder:
            tested = _tested_versions(wheel, Path(folder))
            for python in args.python:
                _download(wheel, args.extras, args.platform, python, out, tested)
    except NoWheel as error:
        raise NoWheel(f"{error}; {args.out} is not complete") from None
    except OSError as error:
        raise BadInput(f"{error.filename or args.out}: {error.strerror}") from None
    wheels = list(out.glob("*.whl"))
    size = sum(path.stat().st_size for path in wheels) / 1e6
    needed = f"what it needs on {args.platform}, Python {' and '.join(args.python)}"
    print(f"{out}: {wheel.name} and {needed}: {len(wheels)} wheels, {size:.0f} MB")
    print(_recipe(out))
    return EXIT_DONE


def own_wheel(folder: Path) -> Path:
    """Write the wheel of this installation of Argosy into `folder` and return its path. Raises NoWheel, OSError.

    pip builds it from an editable checkout; any other installation is packed from its own files.
    """
    installed = distribution("argosy")
    origin = json.loads(installed.read_text("direct_url.json") or "{}")
    if not origin.get("dir_info", {}).get("editable"):
        return _packed(installed, folder)
    checkout = unquote(urlsplit(origin["url"]).path)
    _pip("wheel", "--no-deps", f"--wheel-dir={folder}", checkout, doing=f"building the wheel of {checkout}")
    return max(folder.glob("argosy-*.whl"), key=lambda path: path.stat().st_mtime)


def _packed(installed: Distribution, folder: Path) -> Path:
    """Pack the files that came from a wheel: no scripts, byte code or files of the installer."""
    files = {
        file.as_posix(): file
        for file in installed.files or ()
        if file.hash and file.parts[0] != ".." and "__pycache__" not in file.parts and file.name not in _OF_THIS_MACHINE
    }
    if not files:
        raise NoWheel("this installation has no list of its files: name a wheel by --wheel FILE")
    path = folder / f"argosy-{installed.version}-py3-none-any.whl"
    record = f"argosy-{installed.version}.dist-info/RECORD"
    rows = [f"{name},{file.hash.mode}={file.hash.value},{file.size}\n" for name, file in files.items() if file.hash]
    with ZipFile(path, "w", ZIP_DEFLATED, strict_timestamps=False) as wheel:
        for name, file in files.items():
            wheel.write(str(file.locate()), name)
        wheel.writestr(record, "".join([*rows, f"{record},,\n"]))
    return path


def _given(wheel: Path, out: Path) -> Path:
    if not (wheel.name.startswith("argosy-") and wheel.suffix == ".whl"):
        raise NoWheel(f"--wheel {wheel}: expected a wheel of Argosy, argosy-VERSION-py3-none-any.whl")
    copy = out / wheel.name
    if not (copy.exists() and copy.samefile(wheel)):
        shutil.copyfile(wheel, copy)
    return copy


def _tested_versions(wheel: Path, folder: Path) -> list[str]:
    """Return pip's option for the versions that this Argosy was tested with, which its wheel contains."""
    try:
        with ZipFile(wheel) as files:
            return [f"--constraint={files.extract('schemas/shipped/deploy/constraints.txt', folder)}"]
    except (BadZipFile, KeyError):  # pip refuses what is no wheel; one of an earlier revision has no such file
        return []


def _download(wheel: Path, extras: tuple[str, ...], platform: str, python: str, out: Path, tested: list[str]) -> None:
    """Download the wheels for one platform and Python with pip, and pip itself, which the board may lack."""
    tags = [f"manylinux2014_{platform}", *(f"manylinux_2_{minor}_{platform}" for minor in GLIBC)]
    options = ["--only-binary=:all:", "--implementation=cp", f"--python-version={python}", f"--dest={out}", *tested]
    named = f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
    doing = f"downloading wheels for {platform}, Python {python}"
    _pip("download", *options, *(f"--platform={tag}" for tag in tags), named, "pip", doing=doing)


def _pip(*arguments: str, doing: str) -> None:
    """Run pip, which writes its own errors. Raises NoWheel when it fails or takes more than PATIENCE."""
    if find_spec("pip") is None:
        raise NoWheel(f"{sys.executable} has no pip, which downloads wheels: {sys.executable} -m ensurepip")
    options = ["--quiet", "--no-input", "--disable-pip-version-check", "--timeout=20", "--retries=2"]
    command = [sys.executable, "-m", "pip", *arguments, *options]
    try:
        done = subprocess.run(  # in a session of its own, as ctrl-C would make pip print a traceback: it is killed
            command,
            stdin=subprocess.DEVNULL,
            stdout=sys.stderr,
            timeout=PATIENCE,
            check=False,
            start_new_session=True,
        )
    except subprocess.TimeoutExpired:
        raise NoWheel(f"{doing}: not done within {PATIENCE:.0f} s") from None
    if done.returncode:
        raise NoWheel(f"{doing}: pip failed, see above; this machine must reach a package index")


def _recipe(out: Path) -> str:
    """Return the commands that install on a board, also without pip there: the wheel of pip can be run directly."""
    pip = max(out.glob("pip-*.whl"), key=lambda path: path.stat().st_mtime).name
    return f"""on each board, after `scp -r {out} BOARD:`
  sudo python3 -m venv --without-pip /opt/argosy
  sudo python3 {out.name}/{pip}/pip --python /opt/argosy install --no-index --find-links {out.name} argosy"""


def _platform(text: str) -> str:
    if text in PLATFORMS:
        return text
    if text.startswith("arm"):
        raise ArgumentTypeError(
            f"`{text}` is 32-bit: msgspec and PyYAML have no wheels for it, so boards have to build them"
            " (docs/start/install.md); 64-bit Raspberry Pi OS is aarch64"
        )
    raise ArgumentTypeError(f"expected {' or '.join(PLATFORMS)}, got `{text}`")


def _versions(text: str) -> tuple[str, ...]:
    versions = tuple(text.split(","))
    for version in versions:
        major, _, minor = version.partition(".")
        if major != "3" or not minor.isdecimal() or int(minor) < 11:
            raise ArgumentTypeError(f"expected versions such as 3.11,3.13 (3.11 at least), got `{version}`")
    return versions


def _extras(text: str) -> tuple[str, ...]:
    if text == "none":
        return ()
    extras = tuple(text.split(","))
    if unknown := [extra for extra in extras if extra not in EXTRAS]:
        raise ArgumentTypeError(f"there is no `{unknown[0]}`: expected some of {', '.join(EXTRAS)}, or none")
    return extras
