"""The mind: beliefs, plans, intentions and the reasoning cycle, without I/O.

`state` holds the data that every function takes, `mind` adds the program. `data`, `beliefs` and `plans` define the
parts of the state, `execution` changes it; `introspection` shows it, `persistence` saves and restores it.
"""

import agentd.stdlib  # noqa: F401 - registers the internal actions that programs may use
from agentd.mind.mind import Mind

__all__ = ["Mind"]
