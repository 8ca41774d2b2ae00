"""The configuration of a board's router in a secured fleet, for `commd serve --config` or a `zenohd`.

Other machines connect by mutual TLS, daemons of the board by its socket; access control denies both what
`schemas.mission.access_rules` does not grant (docs/guides/security.md).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from commd.bus.router_endpoints import router_of
from commd.bus.session import BLOCKED_SEND_US, LEASE_MS, NO_SCOUTING, READ_ONLY, dialling, listening_late
from commd.bus.tls import Tls, files_in
from schemas.files.findings import Findings
from schemas.mission import access_rules
from schemas.mission.access_rules import Rights
from schemas.mission.model import Mission
from schemas.wire.codec import MAX_BYTES
from schemas.wire.keys import ROOT, SIGHTS, Sight

MESSAGES = {
    "puts": ["put"],
    "deletes": ["delete"],
    "serves": ["declare_queryable", "reply"],
    "asks": ["query"],
    "hears": ["declare_subscriber"],
    "holds": ["liveliness_token"],
    "watches": ["declare_liveliness_subscriber", "liveliness_query"],
}
"""Zenoh's messages by the right to send them."""
EVERY = [message for messages in MESSAGES.values() for message in messages]
LARGEST_MESSAGE = 2 * MAX_BYTES
"""Bytes; a link that sends a larger one is closed."""
MOST_LINKS = 800
"""Links of machines and daemons to one router: about 50 kB each, and a file descriptor, or three for a machine
(`commd.router.admission`). Zenoh counts both together."""
HERE = "on this board"
"""Subject of daemons that connect by the board's socket, whose file permissions admit them."""


def router_settings(mission: Mission, board: str, *, socket: str, keys: Path | None) -> dict[str, Any]:
    """Return the settings of the router of `board`: its daemons connect at the path `socket`, other machines by TLS.

    `keys` is the folder of the board's keys; without it no other machine is linked. Raises Findings for a mission with
    ambiguous names, and for a manifest that cannot be read.
    """
    access_rules.check(mission)
    if board not in mission.board_names:
        raise Findings.about(mission.path, f"no board `{board}`")
    endpoint = f"unixsock-stream/{socket}"
    listen, connect = router_of(mission, board, endpoint, "tls") if keys is not None else ([], [])
    link: dict[str, Any] = {
        "protocols": ["unixsock-stream", *(["tls"] if keys is not None else [])],
        "tx": {"lease": LEASE_MS, "queue": {"congestion_control": {"block": {"wait_before_close": BLOCKED_SEND_US}}}},
        "rx": {"max_message_size": LARGEST_MESSAGE},
    }
    if keys is not None:
        link["tls"] = files_in(keys).settings()
    return {
        "mode": "router",
        "metadata": {"name": f"commd/{board}"},
        "scouting": NO_SCOUTING,
        # The board's own daemons must not wait for the address of a network that is not up yet.
        "listen": listening_late(endpoint, listen),
        "connect": dialling(connect),
        "transport": {
            "unicast": {"max_sessions": MOST_LINKS},
            "link": link,
            "shared_memory": {"enabled": False},
        },
        "adminspace": READ_ONLY,
        "access_control": access_control(mission, board),
        "low_pass_filter": [
            {
                "id": "no record of ours comes near it",
                "flows": ["ingress"],
                "messages": ["put", "query", "reply"],
                "key_exprs": [f"{ROOT}/**"],
                "size_limit": MAX_BYTES,
            }
        ],
    }


def access_control(mission: Mission, board: str) -> dict[str, Any]:
    """Return Zenoh's `access_control` for the router of a board, which denies what is not allowed.

    A link is judged by its other end, not by the origin of a message: no board may relay for another.
    """
    rules = [_out("out", [f"{ROOT}/**"]), _out("out on this board", ["**", "@/**"])]
    subjects: list[dict[str, Any]] = [{"id": HERE, "link_protocols": ["unixsock-stream"]}]
    policies: list[dict[str, Any]] = []

    def allow(subject: str, rights: Rights, *further: str) -> None:
        own = [
            _rule(f"{subject}: {right}", messages, ["ingress"], key_exprs)
            for right, messages in MESSAGES.items()
            if (key_exprs := list(getattr(rights, right)))
        ]
        rules.extend(own)
        policies.append({"rules": [*(rule["id"] for rule in own), *further], "subjects": [subject]})

    def hide(sight: Sight) -> list[str]:
        """Return the name of the rule that hides what is beyond a sight, if anything is."""
        key_exprs, name = access_rules.hidden(sight), f"beyond {sight}"
        if key_exprs and all(rule["id"] != name for rule in rules):
            rules.append(_out(name, key_exprs) | {"permission": "deny", "messages": ["put", "delete", "reply"]})
        return [name] if key_exprs else []

    allow(HERE, access_rules.of_member(mission, board), "out on this board")
    for other in mission.boards:
        if other != board:
            subject = f"board {other}"
            subjects.append({"id": subject, "cert_common_names": [other], "link_protocols": ["tls"]})
            further = ["out", *hide(access_rules.BOARD_SEES)]
            if simulated := access_rules.robot_keys(mission, board, other):
                further.append(f"{subject}: its robots")
                rules.append(_rule(further[-1], EVERY, ["ingress", "egress"], simulated))
            allow(subject, access_rules.of_board(mission, other), *further)

    def people(subject: str, names: list[str], rights: Rights, sight: Sight) -> None:
        if names:
            subjects.append({"id": subject, "cert_common_names": names, "link_protocols": ["tls"]})
            allow(subject, rights, "out", *hide(sight))

    people("operators", list(mission.security.operators), access_rules.of_operator(mission.inject), "mail")
    for sight in SIGHTS:
        names = [name for name, its in mission.security.sights.items() if its == sight]
        people(f"observers of {sight}", names, access_rules.of_observer(sight), sight)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def write(settings: dict[str, Any]) -> str:
    """Return settings as the text of a file: JSON, which is JSON5."""
    return json.dumps(settings, indent=2) + "\n"


@dataclass(frozen=True)
class RouterFile:
    """A router's configuration, read from a file."""

    config: zenoh.Config
    listen: tuple[str, ...]
    """The endpoints at which it listens; the first is for the board's own daemons."""
    secured: bool
    """Whether access is denied unless allowed."""
    tls: Tls | None
    """Keys for links to other machines."""
    most_links: int
    """Links at most."""


def read(file: Path) -> RouterFile:
    """Read a router's configuration. Raises Findings."""
    try:
        config = zenoh.Config.from_json5(file.read_text(encoding="utf-8"))
        names = ("mode", "listen/endpoints", "access_control", "transport/link/tls", "transport/unicast/max_sessions")
        mode, endpoints, control, tls, most_links = (json.loads(config.get_json(name)) for name in names)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "expected text in UTF-8"
        raise Findings.about(file, f"cannot read it: {why}") from None
    except zenoh.ZError as error:
        why = str(error).partition(" at /")[0]  # what follows are paths of Zenoh's sources
        raise Findings.about(file, f"no configuration of Zenoh's: {why}") from None
    listen = _endpoints(endpoints)
    if mode != "router" or not listen:
        text = 'expected a router: `mode: "router"` and endpoints to listen at, as `argosy units` writes it'
        raise Findings.about(file, text)
    dialled = json.loads(config.get_json("connect/endpoints"))
    allowed = json.loads(config.get_json("transport/link/protocols"))
    for endpoint in (*listen, *_endpoints(dialled)):
        if allowed and (protocol := endpoint.partition("/")[0]) not in allowed:  # Zenoh would wait for ever
            text = f"`{endpoint}` is by {protocol}, but `transport/link/protocols` allows only {', '.join(allowed)}"
            raise Findings.about(file, text)
    files = [tls.get(name) for name in ("root_ca_certificate", "listen_certificate", "listen_private_key")]
    return RouterFile(
        config,
        listen,
        secured=control["enabled"] and control["default_permission"] == "deny",
        tls=Tls(*map(Path, files)) if all(files) else None,
        most_links=most_links,
    )


def set_endpoints(config: zenoh.Config, endpoint: str, others: Sequence[str]) -> None:
    """Set where a router listens: at its board's `endpoint`, which must succeed, and at others."""
    for key, value in listening_late(endpoint, others).items():
        config.insert_json5(f"listen/{key}", json.dumps(value))


def _out(name: str, key_exprs: Sequence[str]) -> dict[str, Any]:
    """Return a rule for messages to a link."""
    return _rule(name, EVERY, ["egress"], key_exprs)


def _rule(name: str, messages: Sequence[str], flows: Sequence[str], key_exprs: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(key_exprs),
    }


def _endpoints(endpoints: Any) -> tuple[str, ...]:
    """Return the endpoints of `listen` or `connect`, a list or a dict by mode, without their options."""
    if isinstance(endpoints, dict):
        endpoints = endpoints.get("router", [])
    return tuple(str(one).partition("#")[0] for one in endpoints or ())
