"""No figure of README and docs was typed by hand: what looks measured stands in a block, or is named here as a limit.

Limits, rates and defaults are decided, not measured: a page may have those that are named here, with the reason. One
that its page has no more fails, too.
"""

import re
from pathlib import Path
from typing import Final

from benchmarks.pages import pages
from benchmarks.results import ROOT

REPORTS: Final = {"soak.md", "faults.md", "attacks.md"}
"""Written by `make soak`, `faults`, `field` and `attacks`: each says when and on what it was made."""
_BLOCK: Final = re.compile(r"<!-- (?:(figures) [\w-]+|(units)) -->\n.*?<!-- end of (?:figures|units) -->", re.DOTALL)
_FENCE: Final = re.compile(r"^(```|~~~).*?^\1", re.DOTALL | re.MULTILINE)
_FIGURE: Final = re.compile(
    r"(?<![\w.,])\d[\d,.]*\s?"
    r"(?:ms|µs|us|ns|kB|MB|GB|KiB|MiB|GiB|%|per cent|times|msg/s|(?:messages|records|cycles)(?:/s| a second))(?!\w)"
    r"|(?<![\w.,])\d+\.\d+ s(?!\w)|(?<!\w)x \d[\d.]*(?!\w)|(?<![\w.,])\d[\d,.]*x(?!\w)"
)

_CODE: Final = re.compile(r"`[^`\n]+`")

_LIMITS: Final = "limits"
_PAUSES: Final = "pauses, and times that are waited"
ALLOWED: Final[dict[str, tuple[str, str]]] = {
    "docs/reference/actions.md": ("1.5 s", _PAUSES),
    "docs/guides/boards.md": ("256 MB, 512 MB, 0.2 s, 0.5 s, 60 times, 200 times", "limits and pauses of the units"),
    "docs/architecture/decisions.md": ("10 times, 0.3 s, 0.1 s, 100 ms, 10 ms", "pauses, and Zenoh's own"),
    "docs/guides/drivers.md": ("0.5 s, 64 KiB, 16 MB, 500 times", "limits and pauses"),
    "docs/guides/monitoring.md": (
        "5.5 s, 0.25 s, 1 GB, 200 MB, 16 kB, 0.5 s, 20 kB, 5 messages/s, 1 %, 8 kB, 0.35 s, 0.7 s, 4 kB",
        "bounds between good, warning and error, what a check sends, limits, and times of a press",
    ),
    "docs/reference/language.md": ("100 times", _LIMITS),
    "docs/guides/command-line-tools.md": ("2.5 s, 4 kB", "limits and defaults"),
    "docs/measurements/daemons.md": ("0.2 s, 2 MB", _LIMITS),
    "docs/guides/mail.md": (
        "0.05 s, 0.1 s, 0.3 s, 0.5 s, 10 times, 1 MB, 256 MB, 256 kB, 64 kB, 64 MB, x 8",
        "limits, pauses, and bits of a byte",
    ),
    "docs/guides/mavlink.md": ("0.5 s, 0.2 s, 64 KiB, 4 KiB, 2 MB, 1 GiB, 64 MiB", "limits and pauses"),
    "docs/reference/records.md": ("0.2 s, 4 kB", _LIMITS),
    "docs/architecture/mind.md": ("100 times", _LIMITS),
    "docs/guides/recording.md": (
        "2 GB, 128 MB, 64 MB, 1000 times, 2 MB, 8 MB, 20 %, 45 %",
        "limits, and the battery of an example",
    ),
    "docs/guides/restart.md": ("0.5 s, 0.3 s, 10 times, 200 times, 1 MB, 64 MB", "limits and pauses"),
    "docs/start/search-and-rescue.md": ("20 %, 1500 us", "what a rescuer goes out with, and when a latch is open"),
    "docs/guides/security.md": (
        "0.1 s, 0.3 s, 0.5 s, 4 MiB, 8 MiB, 16 MiB, 1 MB, 64 MB, 128 kB, 150 kB, 256 kB, 256 MB, 512 MB",
        "limits and pauses",
    ),
    "docs/guides/simulation.md": (
        "0.02 s, 0.1 s",
        "the step of the simulation, and from when on it counts as late",
    ),
}
"""The figures that a page may type, and why."""


def typed(text: str) -> list[str]:
    """Return the figures of a page outside of blocks, and of examples (fences, code)."""
    for apart in (_BLOCK, _FENCE, _CODE):
        text = apart.sub("", text)
    return [found[0] for found in _FIGURE.finditer(text)]


def test_no_figure_was_typed() -> None:
    found = []
    for page in _pages():
        name = str(page.relative_to(ROOT))
        known = ALLOWED.get(name, ("", ""))[0].split(", ")
        found += [f"{name}: {one}" for one in typed(page.read_text(encoding="utf-8")) if one not in known]
    assert not found, "measured? then let a part of benchmarks fill a block; decided? then name it in ALLOWED"


def test_what_is_allowed_is_there_and_has_its_reason() -> None:
    for name, (figures, why) in ALLOWED.items():
        there = typed((ROOT / name).read_text(encoding="utf-8"))
        assert why
        assert [one for one in figures.split(", ") if one not in there] == [], f"{name} has no such figures any more"


def test_figures_are_found_where_they_are_typed_and_not_in_blocks_and_examples() -> None:
    text = """\
A look takes 4.3 ms.
Fast: 22 times python-agentspeak; 6,512 messages/s; x 3.5; 2.31x; 0.22 s; 7 % of a core; 40 MB; 0x1f, 2x2 boards
Three daemons, 2 cores, 12 rows, version 1.10.2, port 7447, 30 s at most, `5 MB`.
<!-- figures mail -->

| latency | 9.3 ms |

<!-- end of figures -->
```text
up again after 1.2 s
```
| 12 µs | and 3 GB |
"""
    found = ["4.3 ms", "22 times", "6,512 messages/s", "x 3.5", "2.31x", "0.22 s", "7 %", "40 MB", "12 µs", "3 GB"]
    assert typed(text) == found


def _pages() -> list[Path]:
    return [page for page in pages() if page.name not in REPORTS and "reference" not in page.parts]
