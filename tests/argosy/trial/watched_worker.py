"""A worker of a trial that notes what its runs use of clocks, chance, ids and threads behind the authority.

`python -m tests.argosy.trial.watched_worker NOTES`.
"""

import datetime
import os
import random
import sys
import threading
import time
import traceback
import uuid
from collections.abc import Callable
from pathlib import Path
from types import BuiltinFunctionType
from typing import Any, Final

ROOT: Final = Path(__file__).parents[3]
PRODUCT: Final = ("schemas", "commd", "bridged", "agentd", "argosy")
CLOCKS: Final = ("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time")
REAL: Final = {getattr(time, name): f"time.{name}" for name in CLOCKS} | {os.urandom: "os.urandom"}
"""What the authority replaces: nothing of the product may have kept it."""
CHANCE: Final = ("random", "uniform", "randint", "randrange", "choice", "choices", "shuffle", "sample", "getrandbits")
WITHOUT_TIME: Final = {"ctime": 1, "asctime": 1, "strftime": 2}
"""Functions of `time` that read the clock if they have fewer arguments."""

NOTES = sys.argv[1]
running = False


def note(what: str) -> None:
    """Note that a run has used something, with the line of the product."""
    if not running:
        return
    folders = tuple(f"{ROOT / package}/" for package in PRODUCT)
    where = next((one for one in reversed(traceback.extract_stack()) if one.filename.startswith(folders)), None)
    at = "?" if where is None else f"{Path(where.filename).relative_to(ROOT)}:{where.lineno}"
    write(f"{what} by {at}")


def write(line: str) -> None:
    """Write a note, in whichever process."""
    with open(NOTES, "a", encoding="utf-8") as notes:
        notes.write(line + "\n")


def noting(what: str, function: Callable[..., Any], least: int = 0) -> Callable[..., Any]:
    """Return a function that notes its calls; with `least`, those with fewer arguments."""

    def noted(*args: Any, **options: Any) -> Any:
        if not least or len(args) < least:
            note(what)
        return function(*args, **options)

    return noted


class _Dates(type):
    def __instancecheck__(cls, instance: object) -> bool:
        return isinstance(instance, _real_datetime)


_real_datetime = datetime.datetime


class _Datetime(_real_datetime, metaclass=_Dates):
    @classmethod
    def now(cls, tz: Any = None) -> Any:
        note("datetime.now")
        return _real_datetime.now(tz)

    @classmethod
    def utcnow(cls) -> Any:
        note("datetime.utcnow")
        return _real_datetime.now(datetime.UTC).replace(tzinfo=None)

    @classmethod
    def today(cls) -> Any:
        note("datetime.today")
        return _real_datetime.today()


class _Random(random.Random):
    def __new__(cls, *seed: Any) -> Any:
        if not seed or seed[0] is None:
            note("Random()")
        return super().__new__(cls, *seed)


def watch() -> None:
    """Note all uses from now on; before the product is imported."""
    for name in CHANCE:
        setattr(random, name, noting(f"random.{name}", getattr(random, name)))
    random.Random = _Random  # type: ignore[assignment, misc]
    datetime.datetime = _Datetime  # type: ignore[misc]
    for name, least in WITHOUT_TIME.items():
        setattr(time, name, noting(f"time.{name}", getattr(time, name), least))
    uuid.uuid1 = noting("uuid.uuid1", uuid.uuid1)
    threading.Thread.start = noting("Thread.start", threading.Thread.start)  # type: ignore[method-assign]


def kept() -> None:
    """Note which modules of the product have kept what the authority replaces."""
    for name, module in sorted(sys.modules.items()):
        if name.partition(".")[0] in PRODUCT and name not in ("argosy.trial.worker", "argosy.trial.edges"):
            for attribute, value in vars(module).items():
                if isinstance(value, BuiltinFunctionType) and value in REAL:
                    write(f"{REAL[value]} kept by {name}.{attribute}")


def main() -> None:
    """Serve requests, watched."""
    watch()
    from argosy.trial import worker
    from argosy.trial.edges import Authority

    begin = Authority.begin

    def begun(self: Authority, seed: int) -> Any:
        global running
        loop = begin(self, seed)
        running = True
        loop.call_later(2.0, kept)
        return loop

    Authority.begin = begun  # type: ignore[method-assign]
    del sys.argv[1:]  # the worker has arguments of its own
    worker.main()


if __name__ == "__main__":
    main()
