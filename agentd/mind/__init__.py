"""The mind: beliefs, plans, intentions and the reasoning cycle, without any input or output of its own."""

import agentd.stdlib  # noqa: F401 - registers the internal actions that programs may use
from agentd.mind.mind import Mind

__all__ = ["Mind"]
