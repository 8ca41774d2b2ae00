"""What several floors share: free loopback ports, a router's endpoint, and how examples are generated.

Hypothesis makes the same examples in each run and judges no times: a test that failed yesterday fails today, and a busy
machine fails none. `make test ARGS=--hypothesis-profile=exploring` looks for new ones.
"""

import faulthandler
import gc
import itertools
import logging
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from hashlib import sha256
from inspect import iscoroutinefunction

import pytest
from hypothesis import HealthCheck, is_hypothesis_test, settings
from xdist.scheduler.loadfile import LoadFileScheduling

from commd.bus.session import sessions_under_way, still_there
from tests.boards.network import NoNamespaces, possible
from tests.support import ports
from tests.support.amount import some_of
from tests.support.buses import Connect, in_a_loop, with_a_router
from tests.support.needs import NEEDS, lacks

settings.register_profile("exploring", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile(
    "reproducible", settings.get_profile("exploring"), derandomize=True, database=None, max_examples=some_of(100, 2)
)
settings.load_profile("reproducible")

gc.disable()  # until the tests are collected: nothing of that is garbage

# Under nohup or in the background they are ignored, which all that tests start would inherit.
for _number, _usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _usual)

_tests = itertools.count()
END_PATIENCE = 60.0
"""Seconds that the interpreter has to end after the last test."""
OTHERS_PATIENCE = 900.0
"""Seconds that one of several processes has: it ends only when the others have done their tests."""
SESSION_PATIENCE = 5.0
"""Seconds that a session which a test has left has to be open, or closed."""


LONGEST = (
    "tests/docs/test_following.py",
    "tests/boards/test_mail.py",
    "tests/test_wheel.py",
    "tests/argosy/run/test_run.py",
    "tests/argosy/run/test_mission_runner.py",
    "tests/argosy/trial/test_missions.py",
    "tests/argosy/trial/test_rescue.py",
    "tests/attacks/test_attacks.py",
    "tests/argosy/test_hostile_texts.py",
    "tests/argosy/watch/test_terminal.py",
    "tests/bridged/test_daemon.py",
    "tests/bridged/drivers/mavlink/test_ground_stations.py",
    "tests/argosy/recording/test_replay.py",
    "tests/commd/test_mail_faults.py",
    "tests/agentd/persistence/test_restart.py",
)
"""Files that take a minute or more, the longest first: of several files at a time, these may not be the last."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first, and mix the others: most of one folder compute, of another wait for processes.

    Mark each test by the fixtures of `NEEDS` that it uses, and as `generated` what makes as many inputs as
    `tests.support.amount` says.
    """

    def turn(item: pytest.Item) -> tuple[int, str]:
        file = item.nodeid.partition("::")[0]
        return LONGEST.index(file) if file in LONGEST else len(LONGEST), sha256(file.encode()).hexdigest()

    items.sort(key=turn)  # stable: those of a file stay in their order
    for item in items:
        for need in set(NEEDS).intersection(getattr(item, "fixturenames", ())):
            item.add_marker(need)
        module = getattr(item, "module", None)
        if hasattr(module, "some_of") or hasattr(module, "THOROUGH") or is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker("generated")


def pytest_collection_finish() -> None:
    """Let no collection of garbage look at the tests themselves: they are many more objects than a test makes."""
    gc.enable()
    gc.freeze()


SPREAD = (
    "tests/docs/test_following.py",
    "tests/argosy/ui/test_page_truth.py",
    "tests/argosy/run/test_mission_runner.py",
)
"""Files that take minutes and whose tests share nothing: of several files at a time, each of their tests is one."""


class Spreading(LoadFileScheduling):
    """A file at a time goes to a process, as by `--dist loadfile`, but for those of `SPREAD`."""

    def _split_scope(self, nodeid: str) -> str:
        file: str = super()._split_scope(nodeid)
        return nodeid if file in SPREAD else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> Spreading | None:
    """Spread the tests that `make test` runs."""
    return Spreading(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_unconfigure(config: pytest.Config) -> None:
    """Show where the run hangs at its end, and end it: a Zenoh session that a failed test left open has threads."""
    one_of_several = hasattr(config, "workerinput")
    faulthandler.dump_traceback_later(OTHERS_PATIENCE if one_of_several else END_PATIENCE, exit=True)


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an async test in an event loop of its own; what a fixture gives as an async context manager is open there."""
    if not iscoroutinefunction(pyfuncitem.obj):
        return None

    async def whole() -> None:
        async with AsyncExitStack() as stack:
            given = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
            for name, value in given.items():
                if isinstance(value, AbstractAsyncContextManager):
                    given[name] = await stack.enter_async_context(value)
            await pyfuncitem.obj(**given)

    in_a_loop(whole)
    return True


@pytest.fixture(autouse=True)
def loggers_as_they_were() -> Iterator[None]:
    """Undo what a command that was run in this process has said of loggers, and remove the handlers that it has left.

    Its levels would silence them for other tests; its handlers would write to a stream that ended with its test.
    """

    def all_of_them() -> dict[logging.Logger, tuple[int, list[logging.Handler]]]:
        found = (one for one in logging.root.manager.loggerDict.values() if isinstance(one, logging.Logger))
        return {one: (one.level, one.handlers[:]) for one in (logging.root, *found)}

    before = all_of_them()
    yield
    for logger, (level, handlers) in all_of_them().items():
        was, had = before.get(logger, (logging.NOTSET, []))
        if was != level:
            logger.setLevel(was)
        for handler in handlers:
            if handler not in had and not type(handler).__module__.startswith("_pytest"):
                logger.removeHandler(handler)


@pytest.fixture(autouse=True)
def state_of_its_own(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let daemons that are told of no folder keep their state where no other test has kept any.

    Commands that are told of no router look for the runs of this process' tests alone, not of all on this machine.
    """
    base = tmp_path_factory.getbasetemp()
    monkeypatch.setenv("XDG_STATE_HOME", str(base / "state" / str(next(_tests))))
    (base / "runtime").mkdir(mode=0o700, exist_ok=True)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(base / "runtime"))


@pytest.fixture(autouse=True)
def sessions_end() -> Iterator[None]:
    """Name the test that leaves a Zenoh session in its opening or closing: it is no failure of those after it."""
    before = sessions_under_way()
    yield
    own = [one for one in sessions_under_way() if one not in before]
    if left := still_there(own, SESSION_PATIENCE):
        names = ", ".join(one.name for one in left)
        warnings.warn(f"after {SESSION_PATIENCE:g} s a Zenoh session is still {names}", stacklevel=1)


@pytest.fixture
def usual_recursion() -> Iterator[None]:
    """Set the limit that Python begins with: what ran before in this process may have raised it."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(1000)
    yield
    sys.setrecursionlimit(before)


@pytest.fixture(scope="session")
def namespaces() -> None:
    """Make sure that boards of network namespaces can be made."""
    try:
        possible()
    except NoNamespaces as why:
        lacks("namespaces", why)


@pytest.fixture(scope="session")
def internet(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Make sure that a package index can be reached."""
    folder = str(tmp_path_factory.mktemp("internet"))
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--retries=0", "--dest", folder, "pip"]
    if subprocess.run(command, timeout=120).returncode:
        lacks("internet", "no package index can be reached")


@pytest.fixture
def free_port() -> Callable[[], int]:
    """Return a function that finds a loopback port which nobody uses now."""
    return ports.free_port


@pytest.fixture
def endpoint(free_port: Callable[[], int]) -> str:
    """Return a router endpoint on loopback that nobody uses."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def connect(endpoint: str) -> AbstractAsyncContextManager[Connect]:
    """Open sessions on a bus whose router is at `endpoint`."""
    return with_a_router(endpoint, 240)
