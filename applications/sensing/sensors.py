"""Photons that take the phase of a sensor, and are measured between X and Y."""

from hosts.hardware import steps
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols, symbols_of
from wire.dispatcher_pb2 import Gate, MeasureRequest, SenseRequest, Step


async def sense(qnic: Qnic, block: BlockName) -> None:
    """Let photons at this host take the phase of its sensor, which is not reported."""
    await qnic.perform(Step(sense=SenseRequest(block=steps.block_id(block))))


async def measure_at(qnic: Qnic, block: BlockName, angle_rad: float) -> Symbols:
    """Measure photons at this host between X (angle 0) and Y (pi/2); shape (k,).

    Return 0 for |0> + exp(i angle) |1> and 1 for the opposite, 255 where no detector clicked;
    the photons are used up.
    """
    turn = Gate(name=Gate.RZ, angle_rad=-angle_rad)
    first = (steps.apply(block, None, turn),) if angle_rad else ()
    measure = MeasureRequest(block=steps.block_id(block), basis=MeasureRequest.X)
    return symbols_of((await qnic.perform(*first, Step(measure=measure)))[-1])
