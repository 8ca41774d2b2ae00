"""docs/reference/commands.md from the parsers of the four programs: `python -m tests.docs.commands_page`."""

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass

from tests.docs.commands import PROGRAMS, parser_of
from tests.docs.pages import ROOT

PAGE = ROOT / "docs/reference/commands.md"
_HEAD = """\
# Commands

<!-- Written by `make reference` from the parsers of the programs. -->

Every command takes `--help`. Exit codes, unless a command says otherwise: 0 done, 1 failed, 2 bad input, 130 ctrl-C.
`ARGOSY_DEBUG=1` in the environment adds to the report of a defect where it came from.
"""
_ABOUT = {
    "argosy": "What the operator uses: runs, checks, watches and stops missions, and prepares boards.",
    "agentd": "Runs the agents' programs.",
    "bridged": "Connects robots by their manifests; simulates robots.",
    "commd": "A board's Zenoh router and its mail.",
}


@dataclass(frozen=True)
class Command:
    """One command that takes arguments of its own."""

    words: tuple[str, ...]
    parser: argparse.ArgumentParser


def all_commands() -> Iterator[Command]:
    """Every command of every program."""
    for program in PROGRAMS:
        for names in _of(program, ()):
            yield Command((program, *names), _leaf(program, names))


def _of(program: str, given: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    choices = _choices(parser_of(program, *given)) if not given else _further(program, given)
    if not choices:
        yield given
        return
    for name in choices:
        yield from _of(program, (*given, name))


def _further(program: str, given: tuple[str, ...]) -> list[str]:
    """The commands below a command: `manifest get`, `simulate copter`."""
    return _choices(_leaf(program, given))


def _choices(parser: argparse.ArgumentParser) -> list[str]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return list(action.choices)
    return []


def _leaf(program: str, names: tuple[str, ...]) -> argparse.ArgumentParser:
    """The parser of a command; a program may have one for all of its commands, or one for each."""
    parser = parser_of(program, *names)
    for name in names:
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction) and name in action.choices:
                parser = action.choices[name]
                break
    return parser


def page() -> str:
    parts, program = [_HEAD], ""
    for command in all_commands():
        if command.words[0] != program:
            program = command.words[0]
            parts.append(f"\n## {program}\n\n{_ABOUT[program]}\n")
        parts.append(_section(command))
    return "".join(parts)


def _section(command: Command) -> str:
    parser = command.parser
    about = _about(parser.description or "")
    actions = [one for one in parser._actions if not isinstance(one, argparse._HelpAction) and not _hidden(one)]
    usage = " ".join([*command.words, *(_form(one) for one in sorted(actions, key=lambda one: not one.option_strings))])
    rows = "".join(f"| {_name(one)} | {_reported(parser, one)} |\n" for one in actions)
    table = f"\n| | |\n|---|---|\n{rows}" if rows else ""
    example = f"\nExample: `{example_of(command)}`\n" if example_of(command) else ""
    return f"\n### {' '.join(command.words)}\n\n{about}\n\n```text\n{_wrapped(usage)}\n```\n{example}{table}"


def example_of(command: Command) -> str:
    """The command line at the end of a command's help; empty = none."""
    return (command.parser.epilog or "").removeprefix("example: ")


def _about(description: str) -> str:
    text = re.sub(r"\n(?!\n)", " ", description.strip()).replace("  ", "\n\n")
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""


def _hidden(action: argparse.Action) -> bool:
    return action.help == argparse.SUPPRESS


def _value(action: argparse.Action) -> str:
    """What stands for the value of an argument."""
    if isinstance(action.metavar, tuple):
        return " ".join(action.metavar)
    if action.choices is not None and action.metavar is None:
        return "|".join(map(str, action.choices))
    return action.metavar or action.dest.upper()


def _several(action: argparse.Action) -> str:
    value = _value(action)
    match action.nargs:
        case "?":
            return f"[{value}]"
        case "*":
            return f"[{value} ...]"
        case "+":
            return f"{value} ..."
        case int():
            return value if isinstance(action.metavar, tuple) else " ".join([value] * action.nargs)
    return value


def _form(action: argparse.Action) -> str:
    if not action.option_strings:
        return _several(action)
    form = action.option_strings[-1] + ("" if action.nargs == 0 else f" {_several(action)}")
    return form if action.required else f"[{form}]"


def _name(action: argparse.Action) -> str:
    if not action.option_strings:
        return f"`{_cell(_value(action))}`"
    value = "" if action.nargs == 0 else f" {_several(action)}"
    return ", ".join(f"`{_cell(option + value)}`" for option in action.option_strings)


def _reported(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return _cell(re.sub(r"\s+", " ", parser._get_formatter()._expand_help(action) if action.help else ""))


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "\\<")


def _wrapped(usage: str) -> str:
    """A usage in lines of at most 92 characters, the further ones indented."""
    lines, words = [""], re.findall(r"\[[^][]*(?:\[[^][]*\][^][]*)*\]\S*|\S+", usage)
    for word in words:
        if len(lines[-1]) + len(word) > 92:
            lines.append("   ")
        lines[-1] += f" {word}" if lines[-1] else word
    return "\n".join(lines)


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
