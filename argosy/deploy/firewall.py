"""Firewall rules for a board's router, which an operator can read and enable: they limit new connections per address.

commd decides which connections to admit (`commd.router.admission`). The rules let the kernel drop, at less cost, what
commd would refuse anyway. They know addresses only, not which of them failed, so their limits are generous.
"""

from __future__ import annotations

import re
from ipaddress import IPv4Address, IPv6Address, ip_address

from argosy.deploy.unit_files import UNITS, Board
from commd.router.admission import ADDRESSES, AT_ONCE, UNHEARD
from schemas.files.units import host_and_port
from schemas.mission.model import DEFAULT_PORT, Mission

_RULES = """\
# Firewall rules of mission {mission}, board {board}. Written by `argosy units`: change the mission, not this file.
# They concern new connections to port {port}, and nothing else: no other port, no connection that is there already.
# Enable them: systemctl enable --now {unit}
# Off again: systemctl disable --now {unit}
# See what is dropped: nft list table inet {table}
# Let an operator's machine in before all others: nft add element inet {table} first4 {{ 10.0.0.5 }}

table inet {table}
delete table inet {table}

table inet {table} {{
    # addresses of the mission's boards: never limited{names}
    set first4 {{ type ipv4_addr; {first4}}}
    set first6 {{ type ipv6_addr; {first6}}}

    # whoever else there is, of IPv6 each /64; where a set is full, further addresses are not limited
    set open4 {{ type ipv4_addr; size {addresses}; flags dynamic; }}
    set open6 {{ type ipv6_addr; size {addresses}; flags dynamic; }}
    set rate4 {{ type ipv4_addr; size {addresses}; flags dynamic, timeout; timeout 1m; }}
    set rate6 {{ type ipv6_addr; size {addresses}; flags dynamic, timeout; timeout 1m; }}

    chain connection {{
        ip saddr @first4 accept
        ip6 saddr @first6 accept
        add @open4 {{ ip saddr ct count over {most} }} counter drop
        add @open6 {{ {net6} ct count over {most} }} counter drop
        update @rate4 {{ ip saddr limit rate over {rate}/second burst {most} packets }} counter drop
        update @rate6 {{ {net6} limit rate over {rate}/second burst {most} packets }} counter drop
    }}

    chain input {{
        type filter hook input priority filter - 1; policy accept;
        iifname "lo" accept
        tcp dport {port} tcp flags & (fin | syn | rst | ack) == syn jump connection
    }}
}}
"""
_UNIT = """\
# Written by `argosy units` from the mission file. Off until it is enabled: read {rules} first.
[Unit]
Description=Argosy: firewall rules of mission {mission}, board {board}
After=nftables.service
PartOf=nftables.service

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=nft -f {rules}
ExecStop=-nft delete table inet {table}
CapabilityBoundingSet=CAP_NET_ADMIN
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=yes

[Install]
WantedBy={target}
"""


def firewall_files(board: Board) -> dict[str, str]:
    """Return the rules and the unit that loads them, by path below the board's root; empty if no machine dials it."""
    if not reachable(board):
        return {}
    mission = board.mission
    first, names = _first(mission)
    values = {
        "mission": mission.name,
        "board": board.name,
        "target": board.target,
        "unit": firewall_unit(board),
        "rules": rules_path(board),
        "table": table(mission),
        "port": host_and_port(mission.boards[board.name].address, DEFAULT_PORT)[1],
        "first4": _elements([one for one in first if isinstance(one, IPv4Address)]),
        "first6": _elements([one for one in first if isinstance(one, IPv6Address)]),
        "names": f"; not known by number here: {', '.join(names)}" if names else "",
        "addresses": ADDRESSES,
        "most": UNHEARD,
        "rate": AT_ONCE,
        "net6": "ip6 saddr & ffff:ffff:ffff:ffff::",
    }
    return {
        rules_path(board)[1:]: _RULES.format(**values),
        f"{UNITS}/{firewall_unit(board)}": _UNIT.format(**values),
    }


def reachable(board: Board) -> bool:
    """Whether other machines dial the board's router."""
    entry = board.mission.boards.get(board.name)
    return entry is not None and bool(entry.address)


def rules_path(board: Board) -> str:
    """Return the path of the rules on the board."""
    return f"{board.folder}/firewall.nft"


def firewall_unit(board: Board) -> str:
    """Return the name of the unit that loads the rules."""
    return f"argosy-{board.mission.name}-firewall.service"


def table(mission: Mission) -> str:
    """Return the name of the nftables table, in characters that nft accepts."""
    return "argosy_" + re.sub(r"[^A-Za-z0-9_]", "_", mission.name)


def _first(mission: Mission) -> tuple[list[IPv4Address | IPv6Address], list[str]]:
    """Return the boards' IP addresses, and their host names: nft would resolve those only once."""
    numbers: list[IPv4Address | IPv6Address] = []
    names: list[str] = []
    for host in dict.fromkeys(one.host for one in mission.boards.values() if one.address):
        try:
            numbers.append(ip_address(host.partition("%")[0]))
        except ValueError:
            names.append(host)
    return numbers, names


def _elements(addresses: list[IPv4Address | IPv6Address]) -> str:
    found = ", ".join(str(one) for one in dict.fromkeys(addresses))
    return f"elements = {{ {found} }}; " if found else ""
