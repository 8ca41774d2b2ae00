"""What the built-in plan ``-!kqml_received`` does: which message could not be handled (message rule 17)."""

from __future__ import annotations

from agentd.mind.data.effects import Print
from agentd.mind.state import MindState


def communication_error(mind: MindState, error: str, message: str) -> None:
    """Print the line that Jason prints when the handling of a message fails."""
    mind.effects.append(Print(f"Communication error -- {error}: {message}"))
