"""Make agents of a project file: find, read and complete their programs, and report its Java features."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec.structs import replace

from agentd.jason_project.project_parser import AgentEntry, ClassSpec, Option, Project, parse_project
from agentd.language.compiler.compile import CompiledProgram, DirectiveError
from agentd.language.parse import parse_term
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import Problem, SyntaxErrors
from agentd.language.syntax_tree.source import read_source
from agentd.language.syntax_tree.traversal import walk
from agentd.mind.data.registry import FUNCTIONS, find_action
from agentd.runtime.program_paths import Setup, SourcePaths
from schemas.files.findings import Finding, Findings

_OF_JASON = (
    "jason.environment.Environment",
    "jason.architecture.AgArch",
    "jason.asSemantics.Agent",
    "jason.bb.DefaultBeliefBase",
    "jason.bb.IndexedBB",
)
"""Classes whose work is done here anyway."""

_ONE_PROCESS = ("Centralised", "Local")
"""Infrastructures in which all agents are in one process, as they are here."""

_USUAL_OPTIONS = {"events": "discard", "intBels": "sameFocus"}
"""Options of Jason whose usual value is how agents are run here."""


def read_project(file: str, paths: SourcePaths, has_environment: bool) -> Setup:
    """Read a project and its programs. ``paths`` are those of the command line; they are searched first.

    Raises OSError if the file cannot be read, `SyntaxErrors` if it or a program does not parse, `Findings` for what
    cannot be run.
    """
    try:
        source = read_source(file)
    except UnicodeDecodeError as error:
        raise Findings([Finding(file, 0, 0, f"is not UTF-8 text (byte {error.start}); save it as UTF-8")]) from None
    project = parse_project(source.text, file)
    setup = Setup()
    setup.warnings += _of_java(project, has_environment)
    setup.paths = project_paths(project, paths, setup.warnings)
    if project.environment is not None:
        setup.environment_arguments = project.environment.arguments
    errors: list[Finding] = []
    broken: list[SyntaxErrors] = []
    for entry in project.agents:
        try:
            _add(setup, project, entry)
        except Findings as found:
            errors += found.findings
        except SyntaxErrors as found:
            broken.append(found)
    errors += _same_names(project)
    if broken:
        others = [Problem(finding, "", 0) for finding in (*errors, *setup.warnings)]
        raise SyntaxErrors([*others, *(problem for found in broken for problem in found.problems)])
    if errors:
        raise Findings([*errors, *setup.warnings])
    return setup


def project_paths(project: Project, paths: SourcePaths, warnings: list[Finding]) -> SourcePaths:
    """Return where the programs of a project are looked for; folders that are not there are added to the warnings."""
    home = Path(project.file).parent
    folders = [*paths.folders, *_source_folders(project, paths, home, warnings)]
    return SourcePaths(paths.names, folders, home)


def _add(setup: Setup, project: Project, entry: AgentEntry) -> None:
    """Add the agents of one entry. Raises Findings and `SyntaxErrors`."""
    program = _program(setup.paths, project, entry)
    items = [item for option in entry.options for item in items_of(option)]
    level = 1
    for option in entry.options:
        match option.name:
            case "beliefs" | "goals":
                pass
            case "verbose":
                if option.value not in ("0", "1", "2"):
                    raise Findings([_finding(option.position, f"verbose must be 0, 1 or 2, not {option.value}")])
                level = int(option.value)
            case name if _USUAL_OPTIONS.get(name) == option.value:
                pass
            case name:
                text = f"the option {name}={option.value} of the agent {entry.name} has no effect here"
                setup.warnings.append(_finding(option.position, text, warning=True))
    setup.warnings += _java_actions(program)
    beliefs = [one for one in items if isinstance(one, nodes.Belief)]
    goals = [one for one in items if isinstance(one, nodes.Goal)]
    program = replace(program, beliefs=(*program.beliefs, *beliefs), goals=(*program.goals, *goals))
    for name in _names(entry):
        setup.programs.append((name, program))
        setup.verbosity[name] = level


def items_of(option: Option) -> Sequence[nodes.Belief | nodes.Goal]:
    """Return the beliefs or goals that an option lists; none for another option. Raises Findings."""
    match option.name:
        case "beliefs":
            return [nodes.Belief(literal, option.position) for literal in _literals(option)]
        case "goals":
            return [nodes.Goal(literal, "!", option.position) for literal in _literals(option)]
        case _:
            return []


def _program(paths: SourcePaths, project: Project, entry: AgentEntry) -> CompiledProgram:
    file, position = entry.program.text, entry.program.position
    try:
        return paths.compiled(file, project.file)
    except OSError as error:
        text = f"cannot read {file}, the program of the agent {entry.name}: {error.strerror or error}"
        raise Findings([_finding(position, text)]) from error
    except DirectiveError as error:
        message = error.message
        java = next((spec for name, spec in project.directives if name.text == error.name), None)
        if java is not None:
            message += f"; its Java class {java.name} cannot be used here"
        raise Findings([_finding(error.position, message)]) from error


def _literals(option: Option) -> list[nodes.Structure]:
    """Return the literals that an option lists. Raises Findings."""
    if not option.value.strip():
        return []
    try:
        found = parse_term(f"[{option.value}]", option.position.file)
    except SyntaxErrors as errors:
        text = f"{option.name}: {errors.findings[0].message}"
        raise Findings([_finding(option.position, text)]) from None
    members = found.items if isinstance(found, nodes.ListTerm) and found.tail is None else ()
    literals = [member for member in members if isinstance(member, nodes.Structure)]
    if not members or len(literals) != len(members):
        text = f'{option.name}="{option.value}": expected literals with commas between them, such as a(1),b'
        raise Findings([_finding(option.position, text)])
    return literals


def _names(entry: AgentEntry) -> list[str]:
    """Return the names of the agents of an entry: ``#3`` makes three of them, numbered from 1."""
    if entry.count == 1:
        return [entry.name]
    return [f"{entry.name}{number}" for number in range(1, entry.count + 1)]


def _same_names(project: Project) -> Iterator[Finding]:
    taken: dict[str, AgentEntry] = {}
    for entry in project.agents:
        for name in _names(entry):
            other = taken.setdefault(name, entry)
            if other is not entry:
                text = f"there is already an agent {name}, in line {other.position.line}"
                yield _finding(entry.position, text)
                break


def _source_folders(project: Project, paths: SourcePaths, home: Path, warnings: list[Finding]) -> Iterator[Path]:
    """Yield the present folders of the source path, from the project's folder and, as in Jason, the working folder.

    The others are warned of.
    """
    for path in project.source_paths:
        try:
            named = paths.expand(path.text)
        except FileNotFoundError as error:
            warnings.append(_finding(path.position, f"aslSourcePath: {error.strerror}", warning=True))
            continue
        folders = [folder for folder in dict.fromkeys((home / named, named)) if folder.is_dir()]
        yield from folders
        if not folders:
            warnings.append(_finding(path.position, f"aslSourcePath: there is no folder {home / named}", warning=True))


# --- Java ---


def _of_java(project: Project, has_environment: bool) -> Iterator[Finding]:
    """Yield the Java features of a project that are not supported; its agents can run without them."""
    infrastructure = project.infrastructure
    if infrastructure is not None and infrastructure.name not in _ONE_PROCESS:
        yield _without(infrastructure, "the infrastructure", "all agents run in this process")
    if project.environment is not None and not has_environment:
        instead = "actions will fail, and nothing is perceived; write it in Python and give --env module:Class"
        yield from _class(project.environment, "the Java environment", instead)
    if project.control is not None:
        yield _without(project.control, "the execution control", "agents run as fast as they can")
    if project.environment_host is not None:
        host = project.environment_host
        yield _finding(
            host.position, f"at {host.text} is not supported: the environment is in this process", warning=True
        )
    for path in project.class_paths[:1]:
        yield _finding(path.position, "the classpath is not used: there is no Java here", warning=True)
    for name, spec in project.directives:
        yield _without(spec, f"the directive {name.text} of the Java class", "a program that uses it cannot be run")
    for entry in project.agents:
        for spec in entry.architectures:
            yield from _class(spec, f"the Java architecture of the agent {entry.name},", "it has the usual one")
        if entry.agent_class is not None:
            yield from _class(entry.agent_class, f"the Java class of the agent {entry.name},", "it reasons as usual")
        if entry.belief_base is not None:
            instead = "beliefs are kept in memory only"
            yield from _class(entry.belief_base, f"the Java belief base of the agent {entry.name},", instead)
        if entry.host is not None:
            text = f"at {entry.host.text} is not supported: the agent {entry.name} runs in this process"
            yield _finding(entry.host.position, text, warning=True)


def _class(spec: ClassSpec, what: str, instead: str) -> Iterator[Finding]:
    if spec.name not in _OF_JASON:
        yield _without(spec, what, instead)


def _without(spec: ClassSpec, what: str, instead: str) -> Finding:
    return _finding(spec.position, f"{what} {spec.name} is not supported: {instead}", warning=True)


def _java_actions(program: CompiledProgram) -> Iterator[Finding]:
    """Internal actions such as ``my.lib.act(X)`` that nothing here provides: in Jason they are Java classes."""
    seen: set[tuple[str, int]] = set()
    own = {(name, arity) for name, arity, _ in program.functions}
    calls = walk(*program.beliefs, *program.goals, *program.plans)
    for call in (node for node in calls if isinstance(node, nodes.InternalAction)):
        name, arity = call.name, len(call.args)
        if name.startswith(".") or (name, arity) in seen or (name, arity) in own or (name, arity) in FUNCTIONS:
            continue
        seen.add((name, arity))
        if find_action(name, arity) is None:
            text = f"nothing provides the internal action {name}/{arity}: write its Java class in Python"
            yield _finding(call.position, text, warning=True)


def _finding(position: nodes.Position, message: str, *, warning: bool = False) -> Finding:
    return Finding(position.file, position.line, position.column, message, "warning" if warning else "error")
