"""Light of pairs: steps that make it, store it, modulate it and find coincidences."""

from hosts.hardware import steps
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic, discard_blocks
from hosts.hardware.replies import (
    Coincidences,
    NoLight,
    Stored,
    Symbols,
    coincidences_of,
    stored_of,
)
from hosts.hardware.steps import Pulses
from wire.dispatcher_pb2 import AttemptRequest, CreateRequest, Step
from wire.optical import frequency_mhz


async def emit_pairs(
    qnic: Qnic, session: int, number: int, count: int, ports: tuple[str, str], pulses: Pulses
) -> None:
    """Make count Bell pairs Phi+ and send their halves 0 and 1 into two ports.

    Return when the last photon has left.
    """
    await qnic.perform(*steps.emission(session, number, count, ports, pulses))


async def begin_pairs(
    qnic: Qnic, session: int, number: int, count: int, ports: tuple[str, str], pulses: Pulses
) -> None:
    emission = steps.emission(session, number, count, ports, pulses)
    qnic.begin(session, *emission)


async def share_pairs(
    qnic: Qnic, session: int, number: int, count: int, port: str, pulses: Pulses
) -> Stored:
    """Make count Bell pairs Phi+, store their halves 0, and send halves 1 into a port.

    Return what the memory has taken, when the last photon has left.
    """
    create = CreateRequest(session=session, number=number, count=count)
    near, far = steps.halves(session, number)
    _made, stored, sent = await qnic.perform(
        Step(create=create),
        steps.store(near, qnic.cutoff_s),
        steps.send({far: port}, pulses),
    )
    return stored_of(stored.arrived, sent)


async def attempt(
    qnic: Qnic, block: BlockName, port: str, wavelength_pm: int, count: int, timeout_s: float
) -> None:
    """Let qubits of the memory attempt to emit into a port, as half of `count` pairs.

    The block is in the memory when the station has reported it: when it has as many, or its
    time is over, which is the longer one of both ends'.
    """
    attempt = AttemptRequest(
        block=steps.block_id(block),
        port=port,
        frequency_mhz=frequency_mhz(wavelength_pm),
        cutoff_s=qnic.cutoff_s,
        count=count,
        timeout_s=timeout_s,
    )
    await qnic.perform(Step(attempt=attempt))


async def modulate(
    qnic: Qnic, block: BlockName, paulis: Symbols, port: str, pulses: Pulses, timeout_s: float
) -> int:
    """Apply one Pauli operator (two bits: X, Z) to each photon that arrives; shape (k,).

    The photons leave by the port they came from. Return the time (ns) at which the first
    one left, when the last has. Raise NoLight if none arrives.
    """
    feedbacks = await qnic.perform(
        steps.receive(block, port, timeout_s),
        steps.apply(block, paulis),
        steps.send({block: port}, pulses),
    )
    return int(feedbacks[-1].first_ns)


async def detect_pairs(
    qnic: Qnic,
    session: int,
    number: int,
    ports: tuple[str, str],
    timeout_s: float,
    following: bool = False,
) -> Coincidences:
    """Make Bell measurements on the halves 0 and 1 that arrive at two ports.

    Raise NoLight if no photon of a half arrives; what arrived of the other stays.
    Following: the caller asks for the blocks behind this one, too, one after the other, each
    with this time-out; the hardware may measure them as they arrive. To end that, cancel the
    wait for one of them, or discard the session.
    """
    detection = steps.detection(steps.halves(session, number), ports, timeout_s)
    if following:
        return coincidences_of(await qnic.perform_repeatedly(session, number, *detection))
    return coincidences_of(await qnic.perform(*detection))


async def detect_arrivals(
    qnic: Qnic, blocks: tuple[BlockName, BlockName], ports: tuple[str, str], timeout_s: float
) -> Coincidences:
    """Make Bell measurements on two blocks that arrive at two ports, made by two hosts.

    Raise NoLight if no photon of one of them arrives; what arrived of the other is discarded.
    """
    try:
        return coincidences_of(await qnic.perform(*steps.detection(blocks, ports, timeout_s)))
    except NoLight:
        await discard_blocks(qnic, blocks)
        raise


async def receive_into_memory(qnic: Qnic, block: BlockName, port: str, timeout_s: float) -> Stored:
    """Store the photons that arrive at a port; raise NoLight if none does.

    From then on they decohere until they are used.
    """
    _received, stored = await qnic.perform(
        steps.receive(block, port, timeout_s), steps.store(block, qnic.cutoff_s)
    )
    return stored_of(stored.arrived, stored)
