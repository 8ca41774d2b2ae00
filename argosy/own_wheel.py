"""The wheel of the Argosy that runs here, so that a board gets exactly this one."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
from importlib.metadata import Distribution, distribution
from pathlib import Path
from urllib.parse import unquote, urlsplit
from zipfile import ZIP_DEFLATED, ZipFile

from argosy.pip_process import NoWheel, run_pip

NAME = "argosy"
BUILD_PATIENCE = 300.0
"""Wall seconds for the build of a checkout's wheel, which first downloads what builds it."""
_OF_THIS_MACHINE = frozenset({"INSTALLER", "REQUESTED", "RECORD", "direct_url.json"})
"""Files of the metadata that an installer adds."""


def own_wheel(folder: Path) -> Path:
    """Write the wheel of this installation into `folder` and return its path. Raises NoWheel.

    An installed wheel is put together again from its files, which needs nothing but them. A checkout is built by pip.
    """
    installed = distribution(NAME)
    checkout = _checkout(installed)
    return _built(checkout, folder) if checkout is not None else _repacked(installed, folder)


def _checkout(installed: Distribution) -> Path | None:
    """Return the folder that is installed in place (`pip install -e`), if it is one."""
    said = json.loads(installed.read_text("direct_url.json") or "{}")
    if not said.get("dir_info", {}).get("editable"):
        return None
    return Path(unquote(urlsplit(said["url"]).path))


def _built(checkout: Path, folder: Path) -> Path:
    options = ["--no-deps", f"--wheel-dir={folder}"]
    run_pip(["wheel", *options, str(checkout)], f"building the wheel of {checkout}", BUILD_PATIENCE)
    return max(folder.glob(f"{NAME}-*.whl"), key=lambda path: path.stat().st_mtime)


def _repacked(installed: Distribution, folder: Path) -> Path:
    files = [file for file in installed.files or () if _belongs(file.parts)]
    if not files:
        raise NoWheel("this installation has no list of its files: name a wheel by --wheel FILE")
    metadata = next(file.parent.as_posix() for file in files if file.parent.name.endswith(".dist-info"))
    tag = next(
        line.partition(":")[2].strip() for line in str(installed.read_text("WHEEL")).splitlines() if "Tag" in line
    )
    record = io.StringIO()
    rows = csv.writer(record, lineterminator="\n")
    path = folder / f"{NAME}-{installed.version}-{tag}.whl"
    try:
        with ZipFile(path, "w", ZIP_DEFLATED) as wheel:
            for file in sorted(files, key=lambda file: (file.as_posix().startswith(metadata), file.as_posix())):
                content = Path(str(file.locate())).read_bytes()
                wheel.writestr(file.as_posix(), content)
                digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
                rows.writerow((file.as_posix(), f"sha256={digest}", len(content)))
            rows.writerow((f"{metadata}/RECORD", "", ""))
            wheel.writestr(f"{metadata}/RECORD", record.getvalue())
    except OSError as error:
        raise NoWheel(f"{error.filename or path}: {error.strerror}") from None
    return path


def _belongs(parts: tuple[str, ...]) -> bool:
    """Whether a file of the installation was in its wheel: no script, no byte code, nothing of this machine."""
    of_machine = parts[0].endswith(".dist-info") and parts[-1] in _OF_THIS_MACHINE
    return parts[0] != ".." and "__pycache__" not in parts and not of_machine
