"""The router's port of a mission that leaves it open."""

import socket
from dataclasses import replace
from pathlib import Path

from msgspec import structs

from argosy.run.command import _router
from schemas.mission.model import Mission, load_mission
from tests.support.ports import free_port

ONE = "mission: one\nagents: {}\nclients: {c: {}}\n"


def mission(folder: Path, text: str) -> Mission:
    path = folder / "one.yaml"
    path.write_text(text)
    return load_mission(path)


def test_a_port_that_is_taken_is_replaced_by_the_next_free_one_unless_the_mission_names_it(tmp_path: Path) -> None:
    port = free_port()
    usual = f"tcp/127.0.0.1:{port}"
    left_open, named = mission(tmp_path, ONE), mission(tmp_path, f"{ONE}router: {{endpoint: {usual}}}\n")
    left_open = replace(left_open, router=structs.replace(left_open.router, endpoint=usual))
    assert _router(left_open) == usual
    with socket.create_server(("127.0.0.1", port)):
        assert _router(named) == usual
        assert int(_router(left_open).rpartition(":")[2]) > port
