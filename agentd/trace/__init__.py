"""The trace of a mind for observers: its inputs, decisions and activity (docs/reference/records.md).

`Tracing` publishes it on three channels of the bus, each only while it has subscribers: `{agent}/trace/inputs`, from
which the mind can be replayed (`agentd.replay.replay`), `.../decisions` and `.../activity` for people.
"""

from agentd.trace.publisher import Tracing

__all__ = ["Tracing"]
