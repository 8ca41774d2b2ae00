"""The recording of a run in virtual time: the file that `argosy record` would write, made from the network itself.

All that is published is recorded where it is sent: no link and no queue loses anything of it. Traces of
agents and percepts by their names are published only while there are subscribers, so subscribers without a callback
are declared at each board's router.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Final

from argosy.recording.backfill import token_seen
from argosy.recording.metadata import Facts
from argosy.recording.recorder import Limits, Recorder
from argosy.recording.write_queue import Heard, WriteQueue
from argosy.trial.network import PUT, Network, Sample, Session
from schemas.mission.model import Mission
from schemas.version import RELEASE
from schemas.wire import keys

MOST, MOST_BYTES = 10_000_000, 1 << 31
"""Messages and bytes of a run, which are kept in memory until its end."""
_ALL: Final = Limits(size=1 << 40)


class TrialRecording:
    """Records one run; `close` writes the file."""

    def __init__(self, path: Path, mission: Mission, network: Network, routers: Iterable[str]) -> None:
        """`routers`: endpoints of the boards' routers. Raises OSError if the file cannot be created."""
        self._queue = WriteQueue(MOST, MOST_BYTES)
        facts = Facts(
            recording=f"{path.stem}-{mission.fleet}",
            fleet=mission.fleet,
            started=time.time_ns(),
            version=RELEASE,
            mission=mission.name,
            mission_file=mission.path.name,
            mission_text=mission.text,
            notes={"trial": path.stem},
        )
        self._recorder = Recorder(path, facts, _ALL, self._queue, overwrite=True)
        network.on_put.append(self._put)
        for number, router in enumerate(routers):
            session = Session(network, 0, router, "recorder", None)
            network.sessions.append(session)
            for wanted in (keys.trace(mission.fleet, "*", "*"), keys.percept(mission.fleet, "*", "*")):
                session.declare_subscriber(wanted, SimpleNamespace(callback=None))
            if number == 0:
                watched = keys.alive(mission.fleet, "*", "*", "*")
                session.liveliness().declare_subscriber(watched, SimpleNamespace(callback=self._token), history=True)

    def _put(self, session: Session, sample: Sample) -> None:
        at = self._queue.now()
        self._queue.put(
            Heard(at, sample.key_expr, sample.payload.to_bytes(), sample.encoding, "put", sample.kind != PUT)
        )

    def _token(self, sample: Sample) -> None:
        if (seen := token_seen(sample.key_expr, sample.kind == PUT, self._queue.now())) is not None:
            self._queue.put(seen)

    def close(self, why: str) -> None:
        """Write what was published, and why it ended. Raises OSError if it cannot be written."""
        ended = Event()
        self._recorder.stop(why)
        self._recorder.start(ended.set)
        ended.wait()
        if self._recorder.problem:
            raise OSError(self._recorder.problem)
