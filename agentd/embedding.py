"""Programs for minds in a Python program of your own: see docs/guides/extending.md."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from agentd.extensions.plugins import discover
from agentd.language.compiler.compile import CompiledProgram, compile_program
from agentd.language.parse import parse_file, parse_program
from agentd.runtime.program_paths import read_folders


def compile_text(text: str, name: str = "program.asl", include_path: Iterable[str] = ()) -> CompiledProgram:
    """A program from its text; ``name`` stands for it in messages, and included files are looked for beside it.

    ``include_path`` is as on the command line: folders to search, ``NAME=FOLDER``. Raises `SyntaxErrors` with all that
    is wrong with the program, `DirectiveError` for a directive that cannot be carried out, ValueError for a folder that
    is not there.
    """
    discover()
    return compile_program(parse_program(text, name), parse_file, read_folders(include_path).find)


def compile_file(path: str | Path, include_path: Iterable[str] = ()) -> CompiledProgram:
    """A program from its file: as `compile_text`, and OSError if it cannot be read."""
    discover()
    return read_folders(include_path).compiled(str(path))
