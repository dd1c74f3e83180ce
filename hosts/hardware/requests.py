"""Requests to the dispatcher, and what its feedback says: blocks by name, and arrays.

What takes the fewest bytes is asked for, and told: eight outcomes to a byte, or four Bell states.
"""

from collections.abc import Sequence

import numpy as np

from hosts.hardware.operations import BlockName
from hosts.hardware.qnic import Coincidences, HardwareError, Stored, Symbols
from wire import dibits
from wire.dispatcher_pb2 import (
    ApplyRequest,
    BellMeasureRequest,
    BlockId,
    CreateRequest,
    Feedback,
    Launch,
    MeasureRequest,
    ReceiveRequest,
    SendRequest,
    Step,
)
from wire.optical import frequency_mhz
from wire.outcomes import NO_COINCIDENCE


def detection(
    names: Sequence[BlockId], ports: tuple[str, str], timeout_s: float
) -> tuple[Step, ...]:
    """Return the steps that receive two blocks and make Bell measurements on their pairs."""
    receive = [
        Step(receive=ReceiveRequest(block=name, port=port, timeout_s=timeout_s))
        for name, port in zip(names, ports, strict=True)
    ]
    measure = BellMeasureRequest(first=names[0], second=names[1], packed=True)
    return *receive, Step(bell_measure=measure)


def emission(
    session: int,
    number: int,
    count: int,
    ports: tuple[str, str],
    rate_hz: int,
    wavelength_pm: int,
) -> tuple[Step, Step]:
    create = CreateRequest(session=session, number=number, count=count)
    halves = enumerate(ports)
    launches = [Launch(block=half_id(session, number, half), port=port) for half, port in halves]
    return Step(create=create), Step(send=send_request(launches, rate_hz, wavelength_pm))


def send_request(launches: list[Launch], rate_hz: int, wavelength_pm: int) -> SendRequest:
    """Return the request to send blocks into ports, at this rate (Hz)."""
    frequency = frequency_mhz(wavelength_pm)
    return SendRequest(launches=launches, rate_hz=rate_hz, frequency_mhz=frequency)


def block_id(block: BlockName) -> BlockId:
    """Return a block's name as messages have it."""
    return half_id(block.session, block.number, block.half)


def stored_of(arrived: bytes, light: Feedback) -> Stored:
    """Return what has been stored of light that has come, or left its source, evenly in time."""
    return Stored(np.frombuffer(arrived, dtype=bool), (light.first_ns + light.last_ns) // 2)


def states_field(states: Symbols) -> dict[str, bytes]:
    """Return the field of a CreateRequest that tells states in the fewest bytes."""
    if states.max(initial=0) > dibits.LARGEST:
        return {"states": states.tobytes()}
    return {"state_dibits": dibits.pack(states, "little")}


def apply_request(name: BlockId, paulis: Symbols) -> ApplyRequest:
    return ApplyRequest(block=name, dibits=dibits.pack(paulis, "little"))


def measure_request(name: BlockId, bases: Symbols) -> MeasureRequest:
    """Return the request to measure in these bases, which are told in the fewest bytes."""
    if bases.max(initial=0) > MeasureRequest.X:
        return MeasureRequest(block=name, bases=bases.tobytes(), packed=True)
    return MeasureRequest(block=name, basis_bits=np.packbits(bases).tobytes(), packed=True)


def outcomes_of(feedback: Feedback) -> Symbols:
    """Return what was measured: 0 or 1, 255 where no detector clicked."""
    return _with_missed(_unpacked(feedback.bits, feedback.photons), feedback)


def _with_missed(outcomes: Symbols, feedback: Feedback) -> Symbols:
    """Return outcomes, and 255 where there was none."""
    if feedback.missed:
        outcomes |= _unpacked(feedback.missed, feedback.photons) * np.uint8(NO_COINCIDENCE)
    return outcomes


def _unpacked(packed: bytes, count: int) -> Symbols:
    """Return the first count bits; HardwareError if there are not just as many bytes."""
    if len(packed) != (count + 7) // 8:
        raise HardwareError(f"the dispatcher tells {len(packed)} bytes of {count} bits")
    return np.unpackbits(np.frombuffer(packed, np.uint8), count=count)


def coincidences_of(feedbacks: Sequence[Feedback]) -> Coincidences:
    feedback = feedbacks[-1]
    outcomes = dibits.unpack(feedback.dibits, feedback.photons, "little")
    return Coincidences(_with_missed(outcomes, feedback), feedback.clicks, feedback.time_ns)


def half_id(session: int, number: int, half: int) -> BlockId:
    """Return the name of one half of a block of pairs."""
    return BlockId(session=session, number=number, half=half)
