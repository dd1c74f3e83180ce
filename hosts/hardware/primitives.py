"""The hardware behind a QNIC, which performs steps (wire/dispatcher.proto).

A driver for real equipment has these methods, and inherits all others from Qnic. Blocks of k
photons are named as on the wire: (session, number, half).
"""

from abc import ABC, abstractmethod
from collections.abc import AsyncIterator

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.block_name import BlockName
from wire.dispatcher_pb2 import Feedback, Step


class Primitives(ABC):
    """The light ports of a host and its source, modulators, memory and detectors."""

    ports: list[str]  # interface names of the fibres, in order
    cutoff_s: float | None = None  # the memory drops older qubits; None: its own, infinity: none

    @abstractmethod
    async def perform(self, *order: Step) -> list[Feedback]:
        """Perform steps one after the other; return the feedback of each.

        Raise NoLight if the first waits for light and none comes, NotHere if a block is elsewhere,
        HardwareError for other failures. The steps before a failure stay done.
        """

    @abstractmethod
    async def perform_repeatedly(self, session: int, number: int, *order: Step) -> list[Feedback]:
        """Perform steps that receive and measure a block of this number, and maybe the next ones.

        The hardware may perform them for the blocks behind it before the call for these.
        """

    @abstractmethod
    def begin(self, session: int, *order: Step) -> None:
        """Perform steps behind those begun before for a session; return at once.

        Raise HardwareError if one of those has failed.
        """

    @abstractmethod
    async def finish(self, session: int) -> None:
        """Wait until all that was begun is over; raise HardwareError if something has failed."""

    @abstractmethod
    def arrivals(self, port: str) -> AsyncIterator[BlockName]:
        """Yield blocks that arrive at a port after this call, where they wait to be received.

        Raise HardwareError if it cannot go on.
        """

    @abstractmethod
    def give_up(self, *blocks: BlockName) -> None:
        """End the wait for light of these blocks by NoLight.

        An operation that has its light goes on to its end.
        """

    @abstractmethod
    async def look(self, block: BlockName, entangled: bool) -> NDArray[np.complex128]:
        """Return the density matrix of a qubit here, perhaps with all it is entangled with.

        Only where states are simulated, and may be looked at; raise HardwareError otherwise.
        """

    @abstractmethod
    def watch(self, session: int, history: bool, follow: bool) -> AsyncIterator[bytes]:
        """Yield what happens at this host (wire.events), of one session or, with 0, of all.

        History: begin with what is remembered. Follow: go on with what happens. Raise
        HardwareError if it cannot go on.
        """

    @abstractmethod
    async def close(self) -> None:
        """Close the hardware."""
