"""What systemd-analyze says of the units that `argosy units` has written, without asking a running systemd."""

import json
import os
import subprocess
from pathlib import Path


def analyzed(out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run systemd-analyze on the units of a tree, in front of this machine's."""
    environment = os.environ | {"SYSTEMD_UNIT_PATH": f"{out}/etc/systemd/system:"}
    command = ["systemd-analyze", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)


def exposure(out: Path, unit: str) -> tuple[float, dict[str, str]]:
    """Return the exposure of a unit, 0 the best and 10 the worst, and what it is made of, by systemd's names."""
    rows = json.loads(analyzed(out, "security", "--offline=true", "--no-pager", "--json=short", unit).stdout)
    said = analyzed(out, "security", "--offline=true", "--no-pager", unit).stdout
    line = next(line for line in said.splitlines() if "Overall exposure level" in line)
    left = {row["json_field"]: row["description"] for row in rows if float(row["exposure"] or 0)}
    return float(line.partition(": ")[2].split()[0]), left


def installed(folder: Path) -> str:
    """Return a place with the commands that the units start: systemd looks whether they are there."""
    for name in ("commd", "bridged", "agentd", "argosy"):
        (folder / "venv/bin").mkdir(parents=True, exist_ok=True)
        (folder / "venv/bin" / name).touch(mode=0o755)
    return str(folder / "venv")
