"""Parser of project files. The sections may be in any order; several errors are reported in one run.

MAS name {
    infrastructure: Centralised
    environment: my.Field(10, "fast") at "host"
    executionControl: my.Control
    agents: bob;  ann people/ann.asl [beliefs="likes(x)", verbose=2] agentArchClass my.Arch #3;
    aslSourcePath: "src/asl"; "lib";
    classpath: "lib/*.jar";
    directives: d = my.Directive;
}
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from agentd.language.syntax_tree.errors import Problem, SyntaxErrors, near, problem_at
from agentd.language.syntax_tree.nodes import NOWHERE, Position
from agentd.language.syntax_tree.source import Source


@dataclass(frozen=True, slots=True)
class Named:
    """A name, path or text, and its place."""

    text: str
    position: Position


@dataclass(frozen=True, slots=True)
class ClassSpec:
    """A Java class, optionally with arguments: ``env.Field(10, "fast")``; the arguments are texts without quotes."""

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

    @property
    def program(self) -> Named:
        """The file of its program: NAME.asl unless one is given; `.asl` may be left out."""
        named = self.file or Named(self.name, self.position)
        return named if Path(named.text).suffix else replace(named, text=f"{named.text}.asl")


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


TOKEN = re.compile(
    r"""(?P<blank>[ \t\r\n\f\ufeff]+|//[^\n]*|/\*.*?\*/)
      | (?P<string>"(?:[^"\\\n]|\\.)*")
      | (?P<number>\d+(?:\.\d+)?(?![\w.$/\\]))
      | (?P<word>(?:[\w$~.-]|/(?![/*])|\\)+)
      | (?P<mark>[{}()\[\]:;,=\#])""",
    re.VERBOSE | re.DOTALL,
)

END = "end"


@dataclass(frozen=True, slots=True)
class Token:
    """``kind`` is string, number, word, mark or end; the text of a string is without quotes."""

    kind: str
    text: str
    at: int
    """Its offset in the source."""

    def __str__(self) -> str:
        if self.kind == END:
            return "the end of the file"
        return f'the text "{self.text}"' if self.kind == "string" else f"'{self.text}'"


def tokenize(source: Source) -> list[Token]:
    """Return the tokens of a source, the last one is its end. Raises `SyntaxErrors` for what is no token."""
    found: list[Token] = []
    text, at, end = source.text, 0, 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise SyntaxErrors([problem_at(source, at, _complaint(text, at))])
        kind = str(match.lastgroup)
        if kind == "string":
            found.append(Token(kind, re.sub(r"\\([\"\\])", r"\1", match.group()[1:-1]), at))
        elif kind != "blank":
            found.append(Token(kind, match.group(), at))
        at = match.end()
        if kind != "blank":
            end = at
    found.append(Token(END, "", end))
    return found


def _complaint(text: str, at: int) -> str:
    if text.startswith('"', at):
        return "this text has no closing quote on its line"
    if text.startswith("/*", at):
        return "this comment is never closed by */"
    return f"'{text[at]}' is not allowed in a project file"


MOST_AGENTS = 10_000
"""More agents than this under one name (``#n``) are taken for a mistake."""

MOST_PROBLEMS = 20


def parse_project(text: str, file: str) -> Project:
    """Parse a project file. Raises `SyntaxErrors` with everything that is wrong with it."""
    return _Parser(Source(text, file)).project()


class _Wrong(Exception):
    """A token is not allowed; parsing continues after the next semicolon."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(str(problem))
        self.problem = problem


@dataclass
class _Parser:
    source: Source
    at: int = 0
    tokens: list[Token] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.tokens = tokenize(self.source)

    # --- the file ---

    def project(self) -> Project:
        """Parse the file. Raises `SyntaxErrors`."""
        try:
            found = self._project()
        except _Wrong as wrong:
            self.problems.append(wrong.problem)
            raise SyntaxErrors(self.problems) from None
        if self.problems:
            raise SyntaxErrors(self.problems[:MOST_PROBLEMS])
        return found

    def _project(self) -> Project:
        if self.token.text not in ("MAS", "mas"):
            raise self.wrong(f"a project begins with: MAS name {{ ... }}; found {self.token}")
        position = self.position
        self.at += 1
        name = self.word("the name of the project").text
        self.mark("{", "after the name of the project")
        project = Project(name, self.source.file, position=position)
        seen: set[str] = set()
        while not self.is_mark("}"):
            if self.token.kind == END:
                raise self.wrong("the project is never closed by '}'")
            project = self._section(project, seen)
        self.at += 1
        if self.token.kind != END:
            raise self.wrong(f"nothing follows the closing '}}' of a project; found {self.token}")
        if "agents" not in seen and not self.problems:
            raise _Wrong(problem_at(self.source, self.tokens[-2].at, "a project needs agents: bob; ann;"))
        return project

    def _section(self, project: Project, seen: set[str]) -> Project:
        keyword = self.token
        if keyword.text not in _SECTIONS or self.tokens[self.at + 1].text != ":":
            raise self.wrong(self._no_section(keyword))
        if keyword.text in seen:
            raise self.wrong(f"there is already a section {keyword.text}")
        seen.add(keyword.text)
        self.at += 2
        match keyword.text:
            case "infrastructure":
                return replace(project, infrastructure=self.class_spec("the infrastructure"))
            case "environment":
                environment = self.class_spec("the class of the environment")
                return replace(project, environment=environment, environment_host=self._host())
            case "executionControl":
                control = self.class_spec("the class of the execution control")
                self._host()
                return replace(project, control=control)
            case "agents":
                return replace(project, agents=self._agents())
            case "aslSourcePath":
                return replace(project, source_paths=self._paths())
            case "classpath":
                return replace(project, class_paths=self._paths())
        return replace(project, directives=self._directives())

    def _no_section(self, keyword: Token) -> str:
        if keyword.text in _SECTIONS:
            return f"a ':' is missing after {keyword.text}"
        hint = near(keyword.text, _SECTIONS) if keyword.kind == "word" else ""
        hint = hint or f"; expected {', '.join(_SECTIONS)} or the closing '}}'"
        return f"{keyword} begins no section{hint}"

    # --- sections ---

    def _agents(self) -> tuple[AgentEntry, ...]:
        agents: list[AgentEntry] = []
        while not self.at_section_end():
            begun = self.at
            try:
                agents.append(self._agent())
            except _Wrong as wrong:
                self.problems.append(wrong.problem)
                self._skip(begun)
        if not agents and not self.problems:
            raise self.wrong(f"an agent is missing after agents: found {self.token}")
        return tuple(agents)

    def _paths(self) -> tuple[Named, ...]:
        found: list[Named] = []
        while not self.at_section_end():
            position, token = self.position, self.token
            if token.kind not in ("string", "word"):
                raise self.wrong(f'a path such as "src/asl" is needed; found {token}')
            self.at += 1
            found.append(Named(token.text, position))
            self.mark(";", "after each path")
        return tuple(found)

    def _directives(self) -> tuple[tuple[Named, ClassSpec], ...]:
        found: list[tuple[Named, ClassSpec]] = []
        while not self.at_section_end():
            name = self.word("the name of a directive")
            self.mark("=", "after the name of a directive")
            found.append((name, self.class_spec("the class of the directive")))
            self.mark(";", "after each directive")
        return tuple(found)

    # --- an agent ---

    def _agent(self) -> AgentEntry:
        name = self.word("the name of an agent")
        if not name.text.isidentifier():
            text = f"'{name.text}' is not a name for an agent: use letters, digits and _"
            raise _Wrong(problem_at(self.source, self.tokens[self.at - 1].at, text))
        entry = AgentEntry(name.text, name.position)
        if self.token.kind == "string" or (self.token.kind == "word" and self.token.text not in _OF_AN_AGENT):
            entry = replace(entry, file=Named(self.token.text, self.position))
            self.at += 1
        while not self.is_mark(";"):
            entry = self._detail(entry)
        self.at += 1
        return entry

    def _detail(self, entry: AgentEntry) -> AgentEntry:
        token = self.token
        if token.text == "[" and token.kind == "mark":
            return replace(entry, options=(*entry.options, *self._options()))
        if token.text == "#" and token.kind == "mark":
            self.at += 1
            return replace(entry, count=self._count())
        match token.text if token.kind == "word" else "":
            case "agentArchClass":
                self.at += 1
                classes = [self.class_spec("an architecture class")]
                while self.is_mark(","):
                    self.at += 1
                    classes.append(self.class_spec("an architecture class"))
                return replace(entry, architectures=(*entry.architectures, *classes))
            case "agentClass":
                self.at += 1
                return replace(entry, agent_class=self.class_spec("an agent class"))
            case "beliefBaseClass":
                self.at += 1
                return replace(entry, belief_base=self.class_spec("a belief base class"))
            case "at":
                return replace(entry, host=self._host())
        if self.at_section_end() or token.kind == END:
            raise self.missing(f"a ';' is missing after the agent {entry.name}")
        hint = near(token.text, _OF_AN_AGENT) or "; is a ';' missing before it?"
        raise self.wrong(f"{token} is not allowed in the entry of the agent {entry.name}{hint}")

    def _options(self) -> list[Option]:
        self.at += 1
        found: list[Option] = []
        while not self.is_mark("]"):
            name = self.word("the name of an option")
            self.mark("=", "after the name of an option")
            if self.token.kind not in ("string", "word", "number"):
                raise self.wrong(f"the value of the option {name.text} is missing; found {self.token}")
            found.append(Option(name.text, self.token.text, name.position))
            self.at += 1
            if not self.is_mark("]"):
                self.mark(",", "or ']' after an option")
        self.at += 1
        return found

    def _count(self) -> int:
        text = self.token.text
        if self.token.kind != "number" or not text.isdigit() or not 1 <= int(text) <= MOST_AGENTS:
            raise self.wrong(f"# must be followed by a number of agents, 1 to {MOST_AGENTS}; found {self.token}")
        self.at += 1
        return int(text)

    def _host(self) -> Named | None:
        if self.token.kind != "word" or self.token.text != "at":
            return None
        self.at += 1
        if self.token.kind not in ("string", "word"):
            raise self.wrong(f"at must be followed by a host; found {self.token}")
        found = Named(self.token.text, self.position)
        self.at += 1
        return found

    # --- tokens ---

    @property
    def token(self) -> Token:
        """The next token."""
        return self.tokens[self.at]

    @property
    def position(self) -> Position:
        """The place of the next token."""
        return self.source.position(self.token.at)

    def is_mark(self, text: str) -> bool:
        """Return whether the next token is this mark."""
        return self.token.kind == "mark" and self.token.text == text

    def at_section_end(self) -> bool:
        """Return whether the next section, the end of the project or of the file follows."""
        if self.token.kind == END or self.is_mark("}"):
            return True
        return self.token.kind == "word" and self.tokens[self.at + 1].text == ":"

    def mark(self, text: str, where: str) -> None:
        """Take this mark; `where` it is needed, for the error."""
        if not self.is_mark(text):
            raise (
                self.missing(f"a '{text}' is missing {where}")
                if text == ";"
                else self.wrong(f"expected '{text}' {where}; found {self.token}")
            )
        self.at += 1

    def word(self, what: str) -> Named:
        """Take a word; `what` it is, for the error."""
        if self.token.kind != "word":
            raise self.wrong(f"{what} is missing; found {self.token}")
        found = Named(self.token.text, self.position)
        self.at += 1
        return found

    def class_spec(self, what: str) -> ClassSpec:
        """Return a class name, optionally with arguments; a list as argument is the text of its members."""
        name = self.word(what)
        arguments: list[str] = []
        if self.is_mark("("):
            self.at += 1
            depth, parts = 0, [""]
            while depth or not self.is_mark(")"):
                token = self.token
                if token.kind == END or (token.kind == "mark" and token.text in "{};:#"):
                    raise self.wrong(f"the arguments of {name.text} are never closed by ')'")
                depth += (token.text in ("(", "[")) - (token.text in (")", "]")) if token.kind == "mark" else 0
                if token.kind == "mark" and token.text == "," and not depth:
                    parts.append("")
                else:
                    parts[-1] += token.text
                self.at += 1
            self.at += 1
            arguments = [part for part in parts if part] if parts == [""] else parts
        return ClassSpec(name.text, tuple(arguments), name.position)

    def wrong(self, message: str) -> _Wrong:
        """Return an error at the next token."""
        return _Wrong(problem_at(self.source, self.token.at, message))

    def missing(self, message: str) -> _Wrong:
        """Return an error behind the token before this one."""
        before = self.tokens[self.at - 1]
        width = len(before.text) + (2 if before.kind == "string" else 0)
        return _Wrong(problem_at(self.source, min(before.at + width, len(self.source.text)), message))

    def _skip(self, begun: int) -> None:
        """Continue after the next semicolon, or at the next section."""
        self.at = max(self.at, begun + 1)
        while not self.at_section_end():
            self.at += 1
            if self.tokens[self.at - 1].text == ";":
                return


_SECTIONS = (
    "infrastructure",
    "environment",
    "executionControl",
    "agents",
    "aslSourcePath",
    "classpath",
    "directives",
)
_OF_AN_AGENT = ("agentArchClass", "agentClass", "beliefBaseClass", "at")
