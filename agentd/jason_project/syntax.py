"""What a project file says: the tree that `agentd.jason_project.project_parser` makes of it."""

from __future__ import annotations

from dataclasses import dataclass

from agentd.language.syntax_tree.nodes import NOWHERE, Position


@dataclass(frozen=True, slots=True)
class Named:
    """A name, path or text, and where it stands."""

    text: str
    position: Position


@dataclass(frozen=True, slots=True)
class ClassSpec:
    """A Java class, maybe with arguments: ``env.Field(10, "fast")``; the arguments are texts without quotes."""

    name: str
    arguments: tuple[str, ...]
    position: Position


@dataclass(frozen=True, slots=True)
class Option:
    """``beliefs="a(1)"`` or ``verbose=2`` of an agent."""

    name: str
    value: str
    position: Position


@dataclass(frozen=True, slots=True)
class AgentEntry:
    """An agent, or ``count`` agents, of a project."""

    name: str
    position: Position
    file: Named | None = None
    options: tuple[Option, ...] = ()
    architectures: tuple[ClassSpec, ...] = ()
    agent_class: ClassSpec | None = None
    belief_base: ClassSpec | None = None
    count: int = 1
    host: Named | None = None


@dataclass(frozen=True, slots=True)
class Project:
    """A project file."""

    name: str
    file: str
    infrastructure: ClassSpec | None = None
    environment: ClassSpec | None = None
    environment_host: Named | None = None
    control: ClassSpec | None = None
    agents: tuple[AgentEntry, ...] = ()
    source_paths: tuple[Named, ...] = ()
    class_paths: tuple[Named, ...] = ()
    directives: tuple[tuple[Named, ClassSpec], ...] = ()
    position: Position = NOWHERE
