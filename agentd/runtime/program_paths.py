"""Find and compile the files of programs: beside the file that names them, in search folders, under ``$name``.

Jason's programs name files of Jason itself as ``$jasonJar/...``; a map gives the folder for such a name.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from agentd.extensions.plugins import discover
from agentd.language.compiler.compile import CompiledProgram, compile_program
from agentd.language.parse import parse_file, parse_program
from agentd.mind.beliefs.work_limit import TooMuchWork, limited
from schemas.files.findings import Finding
from schemas.files.text_files import near_file

USUAL_FOLDERS = (".", "src/agt", "src/agt/inc", "src/asl", "asl")
"""Where projects of Jason keep their programs, below the project's folder; searched last."""


class SourcePaths:
    """Finds the files that programs name.

    ``names`` are the folders of ``$name``, ``folders`` the search folders, ``project`` is the folder that the
    `USUAL_FOLDERS` are below.
    """

    def __init__(
        self, names: Mapping[str, Path] | None = None, folders: Iterable[Path] = (), project: Path | None = None
    ) -> None:
        self.names = dict(names or {})
        self.folders = tuple(folders)
        self.project = project or Path()
        self.advice = ""
        """How the user adds a search folder; part of the error for an included file that is not found."""

    def find(self, path: str, beside: str) -> str:
        """Return the file that ``path`` names in the file ``beside`` (or ``""``).

        Raises FileNotFoundError with the folders that were searched.
        """
        if path.startswith("$"):
            return self._mapped(path)
        candidates = [Path(beside).parent / path]
        if not Path(path).is_absolute():
            usual = [self.project / folder for folder in USUAL_FOLDERS]
            candidates += [folder / path for folder in (*self.folders, *usual)]
        for candidate in candidates:
            if candidate.is_file():
                return str(candidate)
        if os.path.lexists(candidates[0]):
            raise FileNotFoundError(errno.ENOENT, "it is no file, or a link to none", str(candidates[0]))
        looked = [f"{folder}" for folder in dict.fromkeys(c.parent for c in candidates) if folder.is_dir()]
        where = f" (looked in {', '.join(looked)})" if len(looked) > 1 else ""
        advice = self.advice if beside else ""
        raise FileNotFoundError(
            errno.ENOENT, f"No such file or directory{where}{advice}{near_file(candidates[0])}", str(candidates[0])
        )

    def _mapped(self, path: str) -> str:
        found = self.expand(path)
        if not found.is_file():
            raise FileNotFoundError(errno.ENOENT, f"there is no file {found}", str(found))
        return str(found)

    def expand(self, path: str) -> Path:
        """Replace the ``$name`` at the beginning of a path. Raises FileNotFoundError for an unknown name."""
        if not path.startswith("$"):
            return Path(path)
        name, _, rest = path[1:].partition("/")
        folder = self.names.get(name)
        if folder is None:
            hint = f"nothing says which folder ${name} is; give --map '${name}=FOLDER'"
            raise FileNotFoundError(errno.ENOENT, hint, path)
        return folder / rest

    def files_below(self, folder: str, beside: str, pattern: str) -> list[str]:
        """Return the files in a folder and below, sorted, whose path or name matches a regular expression.

        The folder is relative to the project or, if there is no such file, to the file ``beside``.
        Raises OSError, and ValueError for an invalid expression or one that takes too long.
        """
        try:
            form = re.compile(pattern)
        except re.error as error:
            raise ValueError(f"{pattern} is no regular expression: {error}") from error
        top = self.expand(folder)
        for place in (self.project / top, Path(beside).parent / top):
            files = [f"{path}" for path in sorted(place.rglob("*")) if path.is_file()]
            try:
                with limited(f"a search by '{pattern}'"):
                    found = [file for file in files if form.fullmatch(file) or form.fullmatch(Path(file).name)]
            except TooMuchWork as slow:
                raise ValueError(str(slow)) from None
            if found:
                return found
        return []

    def compiled(self, path: str, beside: str = "") -> CompiledProgram:
        """Read and compile the program that ``path`` names. Raises OSError, `SyntaxErrors` and `DirectiveError`."""
        return compile_program(parse_file(self.find(path, beside)), parse_file, self.find)

    def included(self, path: str, beside: str, namespace: str) -> CompiledProgram:
        """Compile a file that a running program includes into a namespace; raises as `compiled` does."""
        return compile_program(parse_file(self.find(path, beside)), parse_file, self.find, namespace)


P = TypeVar("P", bound=SourcePaths)


def read_folders(arguments: Iterable[str], kind: type[P]) -> P:
    """Return the paths of ``--include-path`` arguments: ``FOLDER`` or ``[$]NAME=FOLDER``.

    Raises ValueError for a folder that does not exist, with a text for people.
    """
    names: dict[str, Path] = {}
    folders: list[Path] = []
    for argument in arguments:
        name, equals, folder = argument.partition("=")
        if not equals:
            name, folder = "", argument
        path = Path(folder).expanduser()
        if not folder or not path.is_dir():
            raise ValueError(f"--include-path {argument}: there is no folder {folder or '(empty)'}")
        if name:
            names[name.removeprefix("$").removesuffix("/")] = path
        else:
            folders.append(path)
    paths = kind(names, folders)
    paths.advice = "; give its folder by --include-path FOLDER"
    return paths


@dataclass(slots=True)
class Setup:
    """The agents of a run of `agentd run`, with their programs and settings."""

    programs: list[tuple[str, CompiledProgram]] = field(default_factory=list)
    paths: SourcePaths = field(default_factory=SourcePaths)
    environment_arguments: tuple[str, ...] = ()
    verbosity: dict[str, int] = field(default_factory=dict)
    """By agent, as ``.verbose`` sets it."""
    warnings: list[Finding] = field(default_factory=list)


def compile_text(text: str, name: str = "program.asl", include_path: Iterable[str] = ()) -> CompiledProgram:
    """Compile a program from its text (docs/guides/extending.md).

    ``name`` is the file in messages, and included files are searched beside it. ``include_path`` is as on the command
    line: search folders, and ``NAME=FOLDER``. Raises `SyntaxErrors` with all mistakes of the program, `DirectiveError`
    for a directive that cannot be carried out, ValueError for a folder that does not exist.
    """
    discover()
    return compile_program(parse_program(text, name), parse_file, read_folders(include_path, SourcePaths).find)


def compile_file(path: str | Path, include_path: Iterable[str] = ()) -> CompiledProgram:
    """Compile a program from its file. Raises as `compile_text`, and OSError if it cannot be read."""
    discover()
    return read_folders(include_path, SourcePaths).compiled(str(path))
