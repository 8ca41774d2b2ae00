"""Each row of the fault table (docs/measurements/faults.md) about mail: what waits is neither lost nor doubled, and
all is told."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.faults import mail
from tests.faults.mail import MAIL_INPUT
from tests.faults.mail_files import AS_ROOT, MAIL_FILES
from tests.faults.poison import POISON
from tests.faults.rows import Row
from tests.support.amount import some_of

root = pytest.mark.skipif(os.geteuid() != 0, reason="a file system of its own needs root")


@pytest.mark.parametrize(
    "fault",
    [*MAIL_INPUT, *MAIL_FILES, *POISON, *(pytest.param(row, marks=root) for row in AS_ROOT)],
    ids=lambda fault: fault.__name__,
)
def test_mail_is_neither_lost_nor_doubled_under(
    fault: Callable[[Path], Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mail, "DATAGRAMS", some_of(mail.DATAGRAMS))
    row = fault(tmp_path)
    assert row.seen
    assert row.wrong() == []
