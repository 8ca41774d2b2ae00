"""The course of a mind, for those who follow it: what goes in, what it decides, what it does
(docs/reference/mind-records.md).

`Tracing` is what one agent tells, on three channels of the bus, each while somebody listens: `{agent}/trace/inputs`
with which the mind can be lived again (`agentd.replay.replay`), `.../decisions` and `.../activity` for people.
"""

from agentd.trace.publisher import Tracing

__all__ = ["Tracing"]
