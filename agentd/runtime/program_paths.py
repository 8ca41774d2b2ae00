"""Where the files of a program are looked for: beside the one that names them, in folders to search, under ``$name``.

Jason's programs name files of Jason itself as ``$jasonJar/...``; a map says which folder stands for such a name.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from agentd.language.compiler.compile import CompiledProgram, compile_program, in_namespace
from agentd.language.parse import parse_file

USUAL_FOLDERS = (".", "src/agt", "src/agt/inc", "src/asl", "asl")
"""Where projects of Jason keep their programs, under the project's folder; looked into after all that is named."""


class SourcePaths:
    """Finds the files that programs name.

    ``names`` are the folders that ``$name`` stands for, ``folders`` those to search in, ``project`` is the folder that
    the `USUAL_FOLDERS` are taken from.
    """

    def __init__(
        self, names: Mapping[str, Path] | None = None, folders: Iterable[Path] = (), project: Path | None = None
    ) -> None:
        self.names = dict(names or {})
        self.folders = tuple(folders)
        self.project = project or Path()
        self.advice = ""
        """How the user names a folder to search in; told where an included file is not found."""

    def find(self, path: str, beside: str) -> str:
        """The file that ``path`` names in the file ``beside`` (or ``""``).

        Raises FileNotFoundError, whose text says where it was looked for.
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
        if candidates[0].exists():
            raise FileNotFoundError(errno.ENOENT, "it is no file", str(candidates[0]))
        looked = [f"{folder}" for folder in dict.fromkeys(c.parent for c in candidates) if folder.is_dir()]
        where = f" (looked in {', '.join(looked)})" if len(looked) > 1 else ""
        advice = self.advice if beside else ""
        raise FileNotFoundError(errno.ENOENT, f"No such file or directory{where}{advice}", str(candidates[0]))

    def _mapped(self, path: str) -> str:
        found = self.expand(path)
        if not found.is_file():
            raise FileNotFoundError(errno.ENOENT, f"there is no file {found}", str(found))
        return str(found)

    def expand(self, path: str) -> Path:
        """A path with its ``$name`` replaced; other paths as they are. Raises FileNotFoundError for an unknown name."""
        if not path.startswith("$"):
            return Path(path)
        name, _, rest = path[1:].partition("/")
        folder = self.names.get(name)
        if folder is None:
            hint = f"nothing says which folder ${name} is; give --map '${name}=FOLDER'"
            raise FileNotFoundError(errno.ENOENT, hint, path)
        return folder / rest

    def files_below(self, folder: str, beside: str, pattern: str) -> list[str]:
        """The files in a folder and below, sorted, whose path or name is of the form of a regular expression.

        The folder is looked up from the project; where no such file is there, from where the file ``beside`` stands.
        Raises OSError, and ValueError for an expression that is none.
        """
        try:
            form = re.compile(pattern)
        except re.error as error:
            raise ValueError(f"{pattern} is no regular expression: {error}") from error
        top = self.expand(folder)
        for place in (self.project / top, Path(beside).parent / top):
            files = [f"{path}" for path in sorted(place.rglob("*")) if path.is_file()]
            found = [file for file in files if form.fullmatch(file) or form.fullmatch(Path(file).name)]
            if found:
                return found
        return []

    def compiled(self, path: str, beside: str = "") -> CompiledProgram:
        """Read and compile the program that ``path`` names. Raises OSError, `SyntaxErrors` and `DirectiveError`."""
        return compile_program(parse_file(self.find(path, beside)), parse_file, self.find)

    def included(self, path: str, beside: str, namespace: str) -> CompiledProgram:
        """`compiled` of a file that a running program includes into a namespace."""
        return in_namespace(parse_file(self.find(path, beside)), namespace, parse_file, self.find)


def read_folders(arguments: Iterable[str], project: Path | None = None) -> SourcePaths:
    """The paths that ``--include-path`` arguments describe: ``FOLDER`` or ``[$]NAME=FOLDER``.

    Raises ValueError, in words for people, for a folder that is not there.
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
    paths = SourcePaths(names, folders, project)
    paths.advice = "; give its folder by --include-path FOLDER"
    return paths
