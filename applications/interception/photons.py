"""Photons on their way that are measured and sent on, or counted and split off."""

from hosts.hardware import steps
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols, symbols_of
from wire.dispatcher_pb2 import ResendRequest, SplitRequest, Step

LEFT_ALONE = 255  # instead of a basis


async def resend(qnic: Qnic, block: BlockName, bases: Symbols) -> Symbols:
    """Measure photons at this host and put new ones in their places, in the states found.

    Each has a basis (0 Z, 1 X, 2 Y) or is left alone (255); shape (k,). Return 0 or 1 for
    each, 255 where none was measured or no detector clicked: there, no photon is left.
    """
    request = ResendRequest(block=steps.block_id(block), bases=bases.tobytes())
    (feedback,) = await qnic.perform(Step(resend=request))
    return symbols_of(feedback)


async def split(qnic: Qnic, block: BlockName, into: BlockName) -> Symbols:
    """Count the photons of each pulse at this host; return the counts, shape (k,).

    One photon of each pulse that has several goes into a new block, in the place of its pulse.
    """
    request = SplitRequest(block=steps.block_id(block), into=steps.block_id(into))
    (feedback,) = await qnic.perform(Step(split=request))
    return symbols_of(feedback)
