"""Whether a bridge is there, while the router comes and goes; by a bus that says what the test wants."""

import asyncio
from collections.abc import Callable
from unittest.mock import Mock

import pytest

from commd.liveness.bridge_presence import BridgePresence
from tests.support.buses import until, virtual_test


class Said:
    """A watch and the bus that tells it."""

    def __init__(self) -> None:
        self.bus = Mock(router_up=True, fleet="test")
        self.watch = BridgePresence(self.bus, "uav1", lambda: None, lambda: None)
        self._token: Callable[[str, bool], None] = self.bus.watch.call_args.args[1]
        self._router: Callable[[bool], None] = self.bus.on_router.call_args.args[0]

    def token(self, there: bool) -> None:
        self._token("argosy/test/uav1/alive/bridged/b1", there)

    def router(self, up: bool) -> None:
        self.bus.router_up = up
        self._router(up)


@virtual_test
async def test_a_router_that_comes_and_goes_again_is_no_loss_of_the_bridge(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.liveness.presence.ROUTER_GRACE", 1.0)
    monkeypatch.setattr("commd.liveness.presence.BUS_GRACE", 1.0)
    monkeypatch.setattr("commd.liveness.bridge_presence.BRIDGE_GRACE", 0.01)
    said = Said()
    said.token(True)
    said.router(False)
    said.token(False)
    for up in (True, False, True, False):  # the bridge is not back before the router is lost again
        await asyncio.sleep(0.4)
        said.router(up)
        assert not said.watch.gone
    await until(lambda: said.watch.gone, "the bridge is given up")
    assert asyncio.get_running_loop().time() >= said.watch.router_since + 1.0
