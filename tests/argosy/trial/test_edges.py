"""No process of a trial reads a clock, an id or chance behind the authority."""

import subprocess
import sys
import textwrap
from pathlib import Path

from tests.argosy.trial.test_determinism import outcomes
from tests.support.forked import ROOT

SEED = 3
"""One with kills of each daemon and of the board."""


def notes(folder: Path) -> list[str]:
    """Return what a run has used behind the authority."""
    kept = folder / "notes"
    command = ("-m", "tests.argosy.trial.watched_worker", str(kept))
    (outcome,) = outcomes(folder, command, "0", [SEED])
    assert outcome.messages > 500, outcome.why
    return sorted(set(kept.read_text().splitlines())) if kept.exists() else []


def test_a_run_uses_no_clock_id_chance_or_thread_behind_the_authority(tmp_path: Path) -> None:
    assert notes(tmp_path) == []


def test_the_authority_hands_out_all_clocks_and_chance_by_seed_and_virtual_time() -> None:
    program = """
        from argosy.trial.edges import EPOCH, Authority
        authority = Authority()
        authority.take_over()
        import os, random, resource, secrets, time, uuid
        from concurrent.futures import ThreadPoolExecutor
        from threading import get_ident

        def chance(seed):
            authority.begin(seed)
            return os.urandom(4), random.random(), secrets.token_hex(4), uuid.uuid4(), random.SystemRandom().random()

        assert chance(7) == chance(7) != chance(8)

        async def wait():
            import asyncio
            await asyncio.sleep(1000)
            return time.time() - EPOCH, time.time_ns() / 1e9 - EPOCH, time.monotonic(), time.perf_counter()

        found = authority.begin(1).run_until_complete(wait())
        assert {round(one, 6) for one in found} == {1000}, found
        assert (time.localtime()[:6], time.localtime().tm_gmtoff) == (time.gmtime(EPOCH + 1000)[:6], 0)
        assert time.process_time() == resource.getrusage(resource.RUSAGE_SELF).ru_utime == 0
        assert ThreadPoolExecutor(1).submit(get_ident).result() == get_ident()
        try:
            time.sleep(1)
        except RuntimeError as error:
            print(error)
    """
    ran = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, cwd=ROOT, timeout=60
    )
    assert (ran.stdout, ran.stderr) == ("nothing may sleep in a trial but by the event loop\n", "")


def test_the_command_ends_without_a_word_of_the_interpreter() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", "import argosy.trial.command"], capture_output=True, text=True, cwd=ROOT, timeout=60
    )
    assert (ran.returncode, ran.stderr) == (0, "")
