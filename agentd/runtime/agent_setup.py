"""What a run begins with: its agents' programs, and where further files are."""

from __future__ import annotations

from dataclasses import dataclass, field

from agentd.language.compiler.compile import CompiledProgram
from agentd.runtime.program_paths import SourcePaths
from schemas.files.findings import Finding


@dataclass(slots=True)
class Setup:
    """The agents of a run, and what is settled about them before it begins."""

    programs: list[tuple[str, CompiledProgram]] = field(default_factory=list)
    paths: SourcePaths = field(default_factory=SourcePaths)
    environment_arguments: tuple[str, ...] = ()
    verbosity: dict[str, int] = field(default_factory=dict)
    """Per agent, what ``.verbose`` would set."""
    warnings: list[Finding] = field(default_factory=list)
