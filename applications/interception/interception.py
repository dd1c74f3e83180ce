"""An eavesdropper on a fibre: light that comes by one of her fibres leaves by the other.

    alice ---> first fibre | this host: an attack | second fibre ---> bob

It sends no messages: the attacker needs no session, only light that arrives.
"""

from collections.abc import Awaitable, Callable
from typing import Any

from applications.interception.passing import InterceptionOptions, Passing
from hosts.hardware.qnic import Qnic
from hosts.middleware.session.performing import Performer
from wire.config import HostConfig
from wire.results.figures import EveFigures

Tell = Callable[..., Awaitable[None]]


class Interception:
    """Receives, attacks and sends on whatever arrives at the first fibre."""

    def __init__(
        self, qnic: Qnic, options: InterceptionOptions, seed: int, host: str, memory_qubits: int
    ) -> None:
        self._qnic, self._performer = qnic, Performer(qnic)
        self._passing = Passing(qnic.ports, options, (seed, *host.encode()), memory_qubits)
        self._arrivals = qnic.arrivals(self._passing.inward)  # from now on

    @property
    def summary(self) -> EveFigures:
        return self._passing.summary

    async def run(self, tell: Tell) -> None:
        """Go on until cancelled; report each block. Raise HardwareError if it cannot go on."""
        try:
            async for block in self._arrivals:
                try:
                    seen = await self._performer.perform(self._passing.pass_on(block))
                except BaseException:
                    await self._qnic.discard_block(block.session, block.number)
                    raise
                if seen is not None:
                    await tell(**seen)
        finally:
            await self._performer.perform(self._passing.attack.end())


def prepare(
    config: HostConfig, qnic_at: Callable[[int], Qnic], fields: dict[str, Any]
) -> Interception:
    """Return the interception that these fields describe; raise SessionError if it cannot be."""
    options = InterceptionOptions.from_fields(fields)
    qnic = qnic_at(options.wavelength_pm)
    return Interception(qnic, options, config.seed, config.name, config.memory_qubits)
