"""The MAVLink driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from bridged.drivers.api import SAFETY, Driver, Order, Setup
from bridged.drivers.mavlink.transport.address import LinkAddress, LinkAddressError, link_strings
from schemas.files.findings import Finding
from schemas.files.units import LINK_FORMS
from schemas.manifest.loader import Manifest
from schemas.mission.model import Robot

ORDERS: frozenset[Order] = frozenset(SAFETY)
"""Orders of a robot of this driver without an action of its manifest."""


def check_manifest(manifest: Manifest) -> Iterable[Finding]:
    """Yield a finding for each unknown vehicle, source, field, command and confirmation."""
    from bridged.drivers.mavlink.manifest_validation import check_manifest as check

    return check(manifest)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Yield problems of the link to a vehicle, our ids on it, its passphrase and the links to ground stations."""
    from bridged.drivers.mavlink.vehicle.gcs_failsafe import id_problem

    link = None
    if robot.link:
        try:
            link = LinkAddress.parse(robot.link)
        except LinkAddressError as error:
            yield "link", str(error)
    elif robot.simulate is None or not robot.simulate.process:  # a simulated vehicle is found a free port
        yield "link", f"needs the field `link`: {LINK_FORMS}"
    if problem := id_problem(robot.failsafe, robot.sysid, robot.ids):
        yield "ids", f"ids: {problem}"
    if robot.signing is not None:
        from bridged.drivers.mavlink.transport.signing import SigningError, read_key

        try:
            read_key(Path(robot.signing.passphrase_file))
        except SigningError as error:
            yield "signing", f"signing.passphrase_file: {error}"
    yield from _forward_problems(robot, link)


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one vehicle. Raises SigningError for a passphrase that cannot be used."""
    from bridged.drivers.mavlink.driver import MavlinkDriver

    return MavlinkDriver(setup)


def _forward_problems(robot: Robot, link: LinkAddress | None) -> Iterator[tuple[str, str]]:
    seen = set()
    for text in link_strings(robot.forward):
        try:
            address = LinkAddress.parse(text)
        except LinkAddressError as error:
            yield "forward", f"forward: {error}"
            continue
        if link is not None and (address.host, address.port) == (link.host, link.port):
            yield "forward", f"forward: `{text}` is the vehicle's own link: packets would go round for ever"
        if address in seen:
            yield "forward", f"forward: `{text}` is listed twice"
        seen.add(address)
