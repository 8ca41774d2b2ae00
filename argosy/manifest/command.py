"""`argosy manifest`: manifests in files, and those of running bridges."""

from __future__ import annotations

from argosy.cli.arguments import Command

ABOUT = "Manifests of robots: in files, and of running bridges."
COMMANDS = {
    "check": ("check manifests and print every mistake", "copter manifests/turtle.toml"),
    "schema": ("print the JSON Schema of manifests, for editors", ""),
    "convert": (
        "convert the paper's pair of INI files to one TOML manifest",
        "actions.ini perceptions.ini -o robot.toml",
    ),
    "get": ("print the manifest that a running robot uses, or a part of it", "uav1 percepts.altitude"),
    "set": ("change the manifest of a running robot", "uav1 percepts.altitude.rate=5"),
}


def load(name: str) -> Command:
    """Return what declares the arguments of a command, and what runs it."""
    if name in ("check", "schema", "convert"):
        from argosy.manifest import file_commands

        return getattr(file_commands, f"add_{name}_arguments"), getattr(file_commands, name)
    from argosy.manifest import live_commands

    return getattr(live_commands, f"add_{name}_arguments"), getattr(live_commands, f"{name}_manifest")
