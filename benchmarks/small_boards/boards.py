"""The small boards whose limits are kept, and what is assumed of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from benchmarks import peers
from benchmarks.small_boards.limits import Limits

SYSTEM: Final = 128.0
"""MB of a board's memory that are left to its system, which is a Debian without a desktop."""

OUR_DMIPS: Final = 40_000.0
"""What one core of this machine is taken to do: 10 DMIPS per MHz at 4 GHz. The more is assumed, the less a board is
given. (A Core i7-5960X does 238,310 by 8 cores at 3.0 GHz, which is 9.9 per MHz:
http://scottsoapbox.com/2015/08/15/how-far-weve-come-40-years-of-processing-power)"""


@dataclass(frozen=True)
class Board:
    """A board whose limits are kept."""

    title: str
    memory: float
    """MB."""
    cores: int
    clock: float
    """MHz."""
    dmips_per_mhz: float
    """As ARM gives it for the core."""
    core: str

    @property
    def share(self) -> float:
        """What one of its cores is of one of this machine's."""
        return self.clock * self.dmips_per_mhz / OUR_DMIPS

    @property
    def limits(self) -> Limits:
        return Limits(self.memory - SYSTEM, self.share, self.cores)


BEAGLEBONE: Final = Board("BeagleBone Black", peers.BEAGLEBONE_MB, 1, 1000, 2.0, "Cortex-A8")
PI_3: Final = Board("Raspberry Pi 3", peers.PI_MB, 4, 1200, 2.3, "Cortex-A53")
BOARDS: Final = (BEAGLEBONE, PI_3)
