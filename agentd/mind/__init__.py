"""The mind: beliefs, plans, intentions and the reasoning cycle, without any input or output of its own.

`state` is what every function takes, `mind` the same with a program, for whoever runs it. `data`, `beliefs` and `plans`
are what the state is made of, `execution` what changes it; `introspection` shows it, `persistence` keeps it.
"""

import agentd.stdlib  # noqa: F401 - registers the internal actions that programs may use
from agentd.mind.mind import Mind

__all__ = ["Mind"]
