"""Optional packages, and the command that installs them."""

from __future__ import annotations

import sys
from pathlib import Path

from schemas.version import RELEASE

EXTRAS = {
    "rich": "operator",
    "textual": "operator",
    "prometheus_client": "operator",
    "cryptography": "keys",
    "mcap": "record",
    "aiohttp": "ui",
    "matplotlib": "plot",
}
"""The extra of each package."""


def install_command(extra: str) -> str:
    """Return the command that adds an extra to this installation. It names no index: Argosy is on none."""
    clone = Path(__file__).resolve().parents[2]
    here = clone if (clone / "pyproject.toml").is_file() else f"argosy-{RELEASE}-py3-none-any.whl"
    return f"{sys.executable} -m pip install {'-e ' if here == clone else ''}'{here}[{extra}]'"
