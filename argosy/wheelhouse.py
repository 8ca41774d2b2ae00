"""`argosy wheelhouse`: a folder with all that boards without internet install, downloaded where there is some."""

from __future__ import annotations

import shutil
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path

from argosy.own_wheel import own_wheel
from argosy.pip_process import NoWheel, Offline, run_pip
from commd.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED

PLATFORMS = ("aarch64", "x86_64")
PYTHONS = ("3.11", "3.13")
"""Those of 64-bit Raspberry Pi OS: bookworm and trixie."""
GLIBC = range(17, 37)
"""Minor versions of glibc 2 that the boards' systems can run wheels of: bookworm has 2.36."""
EXTRAS = ("operator", "serial", "keys")
"""What may be wanted on a board besides the daemons."""
PATIENCE = 900.0
"""Wall seconds for the downloads for one Python."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy wheelhouse`."""
    parser.add_argument(
        "--platform", type=_platform, default="aarch64", help="the boards' processor (default: aarch64)"
    )
    parser.add_argument(
        "--python", type=_versions, default=PYTHONS, metavar="X.Y[,X.Y]", help=f"default: {','.join(PYTHONS)}"
    )
    parser.add_argument(
        "--extras", type=_extras, default=EXTRAS, metavar="NAMES", help=f"or `none` (default: {','.join(EXTRAS)})"
    )
    parser.add_argument("--out", type=Path, default=Path("wheelhouse"), metavar="DIR", help="default: wheelhouse")
    parser.add_argument(
        "--wheel", type=Path, metavar="FILE", help="Argosy's own wheel, instead of the one that runs here"
    )


def run(args: Namespace) -> int:
    """Fill the folder. Returns 0 when it holds everything, 1 when something cannot be had, 2 for bad input."""
    try:
        out: Path = args.out
        out.mkdir(parents=True, exist_ok=True)
        wheel = _given(args.wheel, out) if args.wheel is not None else own_wheel(out)
        for python in args.python:
            _download(wheel, args.extras, args.platform, python, out)
    except Offline as error:
        told = "a wheelhouse is made on a machine with internet, and then copied to the boards"
        print(f"error: {error}: {told}; {args.out} is not complete", file=sys.stderr)
        return EXIT_FAILED
    except NoWheel as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILED
    except OSError as error:
        print(f"error: {error.filename or args.out}: {error.strerror}", file=sys.stderr)
        return EXIT_BAD_INPUT
    wheels = list(out.glob("*.whl"))
    size = sum(path.stat().st_size for path in wheels) / 1e6
    needed = f"what it needs on {args.platform}, Python {' and '.join(args.python)}"
    print(f"{out}: {wheel.name} and {needed}: {len(wheels)} wheels, {size:.0f} MB")
    print(_recipe(out, args.extras))
    return EXIT_DONE


def _recipe(out: Path, extras: tuple[str, ...]) -> str:
    """Return how a board installs, also one whose Python came without pip: a wheel of pip can be run as it is."""
    wanted = "argosy[serial]" if "serial" in extras else "argosy"
    pip = max(out.glob("pip-*.whl"), key=lambda path: path.stat().st_mtime).name
    return f"""on each board, after `scp -r {out} BOARD:`
  sudo python3 -m venv --without-pip /opt/argosy
  sudo python3 {out.name}/{pip}/pip --python /opt/argosy install --no-index --find-links {out.name} '{wanted}'"""


def _given(wheel: Path, out: Path) -> Path:
    if not (wheel.name.startswith("argosy-") and wheel.suffix == ".whl"):
        raise NoWheel(f"--wheel {wheel}: expected a wheel of Argosy, argosy-VERSION-py3-none-any.whl")
    copy = out / wheel.name
    if not (copy.exists() and copy.samefile(wheel)):
        shutil.copyfile(wheel, copy)
    return copy


def _download(wheel: Path, extras: tuple[str, ...], platform: str, python: str, out: Path) -> None:
    """Let pip download the wheels of one platform and Python; pip itself too, which the board may lack."""
    tags = [f"manylinux2014_{platform}", *(f"manylinux_2_{minor}_{platform}" for minor in GLIBC)]
    options = ["--only-binary=:all:", "--implementation=cp", f"--python-version={python}", f"--dest={out}"]
    named = f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
    doing = f"downloading wheels for {platform}, Python {python}"
    run_pip(["download", *options, *(f"--platform={tag}" for tag in tags), named, "pip"], doing, PATIENCE)


def _platform(text: str) -> str:
    if text in PLATFORMS:
        return text
    if text.startswith("arm"):
        raise ArgumentTypeError(
            f"`{text}` is 32-bit: msgspec and PyYAML have no wheels for it, so boards have to build them"
            " (docs/install.md); 64-bit Raspberry Pi OS is aarch64"
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
