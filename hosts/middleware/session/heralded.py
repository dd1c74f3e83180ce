"""The end that does not ask the station: it attempts, hears what was heralded, and corrects it."""

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.qnic import BlockName
from hosts.middleware.session.blocks import keep_of_all, store
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import ConnectionEnd
from hosts.timeouts import HERALD_TIMEOUT_S
from wire.metadata import Reason, Topic

MAX_STATE = 3


async def correct_heralded(
    end: ConnectionEnd, name: BlockName, size: int, port: str
) -> tuple[NDArray[np.bool_], int]:
    """Attempt for a block that was announced, and make Phi+ of what is heralded behind the paths.

    Return which of the heralded pairs are kept, as the other end is told, and the mean time (ns)
    from which they wait.
    """
    qnic, number = end.qnic, name.number
    await qnic.attempt(name, port, end.setup.wavelength_pm)
    end.agree()
    states = await end.hear(Topic.HERALDED, number, None, MAX_STATE, HERALD_TIMEOUT_S)
    if states.size > size:
        text = f"{states.size} pairs of block {number} heralded, of {size}"
        raise SessionError(Reason.PROTOCOL, text)
    kept, since_ns = np.zeros(0, dtype=bool), 0
    if states.size:
        since_ns = (await qnic.store(name)).since_ns
        await qnic.apply(name, (states ^ end.setup.rotation).astype(np.uint8))
        kept = await store(qnic, name)
        await keep_of_all(qnic, name, kept)
    end.say(Topic.ARRIVED, number, kept, 1)
    return kept, since_ns
