"""The commands of `sh` and `console` blocks, what they shall print, and whether Argosy's own parsers take them."""

import argparse
import contextlib
import importlib
import io
import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn
from unittest.mock import patch

from commd.process.command_line import Parser
from tests.docs.pages import COMMANDS, Block, blocks, without_blocks
from tests.docs.table import NOT_COMMANDS, entry

PROGRAMS = ("argosy", "agentd", "bridged", "commd")
_PLACEHOLDER = re.compile(r"(?:.*[=/:])?[A-Z][A-Z0-9_]*(?:/.*|\.[a-z0-9]+)?|.*\.\.\.|<.*>")
_HEREDOC = re.compile(r"<<-?\s*'?(\w+)'?")
_SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")


@dataclass(frozen=True)
class Command:
    """A command of a page; ``output`` is what a `console` block shows below it, None in a `sh` block."""

    page: str
    line: int
    text: str
    output: tuple[str, ...] | None = None
    in_prose: bool = False
    """It stands within a sentence, where `argosy run` is a name and needs no arguments."""

    @property
    def where(self) -> str:
        return f"{self.page}:{self.line}"


def commands(block: Block) -> list[Command]:
    return list(_console(block) if block.language == "console" else _script(block))


def _script(block: Block) -> Iterator[Command]:
    at, text = 0, ""
    for number, line in enumerate(block.text.splitlines(), block.line + 1):
        if text and (_goes_on(text) or line.startswith("  ")):  # what is indented belongs to the command above it
            text += f"\n{line}"
        elif line.strip() and not line.startswith("#"):
            if text:
                yield Command(block.page, at, text)
            at, text = number, line
    if text:
        yield Command(block.page, at, text)


def _console(block: Block) -> Iterator[Command]:
    at, text, shown = 0, "", list[str]()
    for number, line in enumerate(block.text.splitlines(), block.line + 1):
        if text and not shown and _goes_on(text):
            text += f"\n{line.removeprefix('> ')}"
        elif line.startswith("$ "):
            if text:
                yield Command(block.page, at, text, tuple(shown))
            at, text, shown = number, line[2:], []
        elif not text:
            raise ValueError(f"{block.where}: a console block begins with `$ ` and a command")
        else:
            shown.append(line.rstrip())
    if text:
        yield Command(block.page, at, text, tuple(shown))


def _goes_on(text: str) -> bool:
    """Whether a shell reads on: after a backslash, in open quotes, up to the end of a here-document."""
    if here := _HEREDOC.search(text):
        return here[1] not in (line.strip() for line in text.splitlines()[1:])
    if text.endswith("\\"):
        return True
    try:
        shlex.split(text, comments=True)
    except ValueError:
        return True
    return False


def mentions(page: str) -> Iterator[Command]:
    """All that a page says in blocks of commands, and in the code within its sentences that is a command of ours."""
    for block in blocks(page):
        if block.language in COMMANDS:
            yield from commands(block)
    for number, line in enumerate(without_blocks(page).splitlines(), 1):
        for span in _SPAN.findall(line):
            first, _, rest = span.partition(" ")
            if first in PROGRAMS and rest and entry(NOT_COMMANDS, page, span) is None:
                yield Command(page, number, span, in_prose=True)


def calls(text: str) -> Iterator[list[str]]:
    """The calls of our programs in a line of shell: `cd x && argosy run y | head` has one."""
    with contextlib.suppress(ValueError):  # quotes of a sentence
        words: list[str] = []
        shell = text.partition("\n")[0] if "<<" in text else re.sub(r"\s*\\?\n {2,}", " ", text)
        lexer = shlex.shlex(shell, posix=True, punctuation_chars="();<>|&\n")
        lexer.whitespace_split, lexer.commenters, lexer.whitespace = True, "#", " \t\r"
        for word in [*lexer, ";"]:
            if set(word) <= set("();<>|&\n"):
                yield from _call(words)
                words = []
            else:
                words.append(word)


def _call(words: Sequence[str]) -> Iterator[list[str]]:
    for at, word in enumerate(words):
        name = word.rpartition("/")[2]
        if name in PROGRAMS and (at == 0 or words[at - 1] in ("-m", "sudo", "exec", "timeout") or _prefix(words[:at])):
            yield [name, *words[at + 1 :]]
            return


def _prefix(words: Sequence[str]) -> bool:
    """Assignments, and what runs something else under it."""
    return all("=" in word or word in ("sudo", "nice", "time", "env", "$", "systemd-run") for word in words)


def is_a_form(text: str) -> bool:
    """Whether a command is the form of commands, with placeholders: `argosy run MISSION [--speed X]`."""
    if "<<" in text:
        return False
    try:
        words = shlex.split(text, comments=True)
    except ValueError:
        return False
    return any(_PLACEHOLDER.fullmatch(word.strip("[]")) or word.startswith("[-") for word in words[1:])


class _ParsedError(BaseException):
    """A command line was taken; never an Exception, which the programs catch."""

    def __init__(self, parser: argparse.ArgumentParser, arguments: argparse.Namespace | None) -> None:
        super().__init__()
        self.parser, self.arguments = parser, arguments


_Parse = Callable[..., argparse.Namespace]


@contextlib.contextmanager
def _only_parsing(prepare: Callable[[argparse.ArgumentParser], bool]) -> Iterator[None]:
    """Let programs do nothing but parse, and not even that where ``prepare`` is false; both end in a _ParsedError."""

    def ending(parse: _Parse) -> _Parse:
        def parsed(parser: argparse.ArgumentParser, args: Any = None, namespace: Any = None) -> NoReturn:
            raise _ParsedError(parser, parse(parser, args, namespace) if prepare(parser) else None)

        return parsed

    with contextlib.ExitStack() as patches:
        for kind in (argparse.ArgumentParser, Parser):
            for name in ("parse_args", "parse_intermixed_args"):
                patches.enter_context(patch.object(kind, name, ending(getattr(kind, name))))
        yield


def parser_of(program: str, *names: str) -> argparse.ArgumentParser:
    """The parser by which a program reads the arguments of its command ``names``, such as `argosy manifest get`."""
    with _only_parsing(lambda parser: False):
        try:
            importlib.import_module(f"{program}.__main__").main(list(names))
        except _ParsedError as parsed:
            return parsed.parser
    raise AssertionError(f"{program} {' '.join(names)} parses nothing")


def complaint(call: Sequence[str], in_prose: bool = False) -> str:
    """What the program's own parser says against a command line; empty when it takes it."""
    program, *arguments = _without_brackets(call)
    printed = io.StringIO()

    def loosen(parser: argparse.ArgumentParser) -> bool:
        _loosen(parser, in_prose)
        return True

    with _only_parsing(loosen), contextlib.redirect_stderr(printed), contextlib.redirect_stdout(io.StringIO()):
        try:
            importlib.import_module(f"{program}.__main__").main(arguments)
        except _ParsedError:
            return ""
        except SystemExit as end:
            return printed.getvalue().strip().rpartition("\n")[2] if end.code else ""
    return f"{program} takes no `{' '.join(arguments)}`: {printed.getvalue()}"


def _without_brackets(call: Sequence[str]) -> list[str]:
    """A form of commands as one of them: with all that is in brackets, without dots, the first of alternatives."""
    words: list[str] = []
    for word in (word.strip("[]") for word in call):
        if word == "..." and words[-1].startswith("-"):
            words.append("VALUE")
        elif word not in ("...", "|", ""):
            words.append(word.removesuffix("...").partition("|")[0])
    return words


def _loosen(parser: argparse.ArgumentParser, in_prose: bool) -> None:
    """Let a word in capitals stand for any value (`--speed X`), and in a sentence let arguments be missing."""
    for group in parser._mutually_exclusive_groups:
        group.required = group.required and not in_prose
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            action.required = action.required and not in_prose
            for one in action.choices.values():
                _loosen(one, in_prose)
            continue
        if action.choices is not None:
            action.type, action.choices = _one_of(list(action.choices)), None
        elif callable(action.type):
            action.type = _or_a_placeholder(action.type)
        if in_prose:
            action.required = False
            action.nargs = "?" if action.nargs is None else "*" if action.nargs == "+" else action.nargs


def _one_of(choices: list[Any]) -> Callable[[str], Any]:
    def one(text: str) -> Any:
        if text not in map(str, choices):
            raise ValueError
        return text

    return _or_a_placeholder(one)


def _or_a_placeholder(kind: Callable[[str], Any]) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        return text if all(_PLACEHOLDER.fullmatch(part) for part in text.split(",")) else kind(text)

    read.__name__ = getattr(kind, "__name__", "value")
    return read
