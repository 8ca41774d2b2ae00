"""The configuration of a board's router, as it is written and read."""

import json
from pathlib import Path
from typing import Any

import pytest

from commd.bus.tls import files_in
from commd.router.config import read, router_settings, write
from schemas.files.findings import Findings
from schemas.mission.model import load_mission, read_mission
from tests.schemas.mission.test_access_rules import FLEET

SHIPPED = Path(__file__).parents[3] / "missions"


def settings(board: str = "pi1", keys: Path | None = Path("/etc/keys")) -> dict[str, Any]:
    return router_settings(read_mission(FLEET, Path("m.yaml")), board, socket="/run/argosy/m.sock", keys=keys)


def test_a_router_listens_for_machines_by_tls_and_for_its_board_at_a_socket() -> None:
    made = settings("pi2")
    assert made["listen"]["endpoints"] == [
        "unixsock-stream//run/argosy/m.sock#exit_on_failure=true",
        "tls/10.0.0.2:7447",
    ]
    assert made["connect"]["endpoints"] == ["tls/10.0.0.1:7447"]
    assert made["transport"]["link"]["protocols"] == ["unixsock-stream", "tls"]
    assert made["transport"]["link"]["tls"]["enable_mtls"] is True
    assert made["adminspace"]["permissions"]["write"] is False


def test_what_is_not_allowed_is_denied_and_each_party_is_known_by_its_certificate() -> None:
    control = settings()["access_control"]
    assert (control["enabled"], control["default_permission"]) == (True, "deny")
    subjects = {one["id"]: (one.get("cert_common_names"), one["link_protocols"]) for one in control["subjects"]}
    assert subjects == {
        "on this board": (None, ["unixsock-stream"]),
        "board pi2": (["pi2"], ["tls"]),
        "operators": (["ops"], ["tls"]),
        "observers of telemetry": (["eye"], ["tls"]),
    }
    denied = [rule["id"] for rule in control["rules"] if rule["permission"] != "allow"]
    assert denied == ["beyond telemetry"]  # of what is allowed by `out`: minds and mail
    named = {rule["id"] for rule in control["rules"]}
    assert {name for policy in control["policies"] for name in policy["rules"]} <= named


def test_without_keys_no_other_machine_is_reached() -> None:
    made = settings(keys=None)
    assert made["listen"]["endpoints"] == ["unixsock-stream//run/argosy/m.sock#exit_on_failure=true"]
    assert (made["connect"]["endpoints"], made["transport"]["link"]["protocols"]) == ([], ["unixsock-stream"])


@pytest.mark.parametrize("name", [file.name for file in sorted(SHIPPED.glob("*.yaml"))])
def test_zenoh_reads_what_is_written_for_the_shipped_missions(name: str, tmp_path: Path) -> None:
    mission = load_mission(SHIPPED / name)
    for board in mission.board_names:
        file = tmp_path / f"{board}.json5"
        file.write_text(write(router_settings(mission, board, socket="/run/a.sock", keys=tmp_path)), encoding="utf-8")
        found = read(file)
        assert found.secured
        assert found.listen[0] == "unixsock-stream//run/a.sock"
        assert found.tls == files_in(tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{mode: "client"}', "expected a router"),
        ('{mode: "router", listen: {endpoints: []}}', "expected a router"),
        ("{", "no configuration of Zenoh's"),
        ('{mode: "router", acess_control: {}}', "no configuration of Zenoh's"),
        (
            '{mode: "router", listen: {endpoints: ["tcp/127.0.0.1:1"]}, transport: {link: {protocols: ["tls"]}}}',
            "`tcp/127.0.0.1:1` is by tcp, but `transport/link/protocols` allows only tls",
        ),
    ],
)
def test_a_file_that_is_no_routers_configuration_is_refused_in_words(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "router.json5"
    file.write_text(text)
    with pytest.raises(Findings, match=said):
        read(file)
    with pytest.raises(Findings, match="cannot read it"):
        read(tmp_path / "nowhere.json5")


def test_a_router_of_somebody_elses_making_is_taken_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "router.json5"
    file.write_text(json.dumps({"mode": "router", "listen": {"endpoints": {"router": ["tcp/127.0.0.1:7000"]}}}))
    found = read(file)
    assert (found.listen, found.secured, found.tls) == (("tcp/127.0.0.1:7000",), False, None)


def test_a_board_that_the_mission_has_not_is_refused() -> None:
    with pytest.raises(Findings, match="no board `pi9`"):
        settings("pi9")
