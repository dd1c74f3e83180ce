"""Steps of the dispatcher's orders: blocks by name, and arrays in the fewest bytes."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.block_name import BlockName
from hosts.hardware.replies import Symbols
from wire import dibits
from wire.dispatcher_pb2 import (
    ApplyRequest,
    BellMeasureRequest,
    BlockId,
    CreateRequest,
    DiscardRequest,
    Gate,
    GatherRequest,
    Launch,
    MeasureRequest,
    Pick,
    PulseKey,
    ReceiveRequest,
    SendRequest,
    Step,
    StoreRequest,
)
from wire.keyed import KeyedChoices
from wire.optical import frequency_mhz
from wire.positions import pack


class Pulses(NamedTuple):
    rate_hz: int
    wavelength_pm: int


def block_id(block: BlockName) -> BlockId:
    return BlockId(session=block.session, number=block.number, half=block.half)


def halves(session: int, number: int) -> tuple[BlockName, BlockName]:
    return BlockName(session, number, 0), BlockName(session, number, 1)


def prepare(name: BlockName, states: Symbols, levels: Symbols | None) -> Step:
    create = CreateRequest(session=name.session, number=name.number, count=states.size)
    create.state = CreateRequest.PREPARED
    if states.max(initial=0) > dibits.LARGEST:
        create.states = states.tobytes()
    else:
        create.state_dibits = dibits.pack(states, "little")
    create.levels = b"" if levels is None else levels.tobytes()
    return Step(create=create)


def prepare_by_key(name: BlockName, choices: KeyedChoices) -> Step:
    create = CreateRequest(session=name.session, number=name.number, count=choices.count)
    create.state = CreateRequest.PREPARED
    create.key.CopyFrom(PulseKey(key=choices.key, shares=choices.shares))
    return Step(create=create)


def measure_by_key(block: BlockName, key: bytes) -> Step:
    """Return the step that measures in bases that a key chooses; its feedback has gaps."""
    return Step(measure=MeasureRequest(block=block_id(block), key=key))


def emission(
    session: int, number: int, count: int, ports: tuple[str, str], pulses: Pulses
) -> tuple[Step, Step]:
    create = CreateRequest(session=session, number=number, count=count)
    return Step(create=create), send(dict(zip(halves(session, number), ports, strict=True)), pulses)


def send(light: dict[BlockName, str], pulses: Pulses) -> Step:
    launches = [Launch(block=block_id(block), port=port) for block, port in light.items()]
    frequency = frequency_mhz(pulses.wavelength_pm)
    request = SendRequest(launches=launches, rate_hz=pulses.rate_hz, frequency_mhz=frequency)
    return Step(send=request)


def receive(block: BlockName, port: str, timeout_s: float) -> Step:
    return Step(receive=ReceiveRequest(block=block_id(block), port=port, timeout_s=timeout_s))


def detection(
    blocks: Sequence[BlockName], ports: tuple[str, str], timeout_s: float
) -> tuple[Step, ...]:
    """Return the steps that receive two blocks and make Bell measurements on their pairs."""
    light = zip(blocks, ports, strict=True)
    return *(receive(block, port, timeout_s) for block, port in light), bell_measure(*blocks)


def bell_measure(first: BlockName, second: BlockName) -> Step:
    """Return the step that makes Bell measurements; its feedback has four to a byte."""
    request = BellMeasureRequest(first=block_id(first), second=block_id(second), packed=True)
    return Step(bell_measure=request)


def measure(block: BlockName, bases: Symbols) -> Step:
    """Return the step that measures in these bases; its feedback has eight to a byte."""
    request = MeasureRequest(block=block_id(block), packed=True)
    if bases.max(initial=0) > MeasureRequest.X:
        request.bases = bases.tobytes()
    else:
        request.basis_bits = np.packbits(bases).tobytes()
    return Step(measure=request)


def apply(block: BlockName, paulis: Symbols | None = None, *gates: Gate) -> Step:
    packed = b"" if paulis is None else dibits.pack(paulis, "little")
    return Step(apply=ApplyRequest(block=block_id(block), dibits=packed, gates=gates))


def gather(into: BlockName, picks: Iterable[Pick], keep_rest: bool) -> Step:
    request = GatherRequest(into=block_id(into), picks=picks, keep_rest=keep_rest)
    return Step(gather=request)


def pick(block: BlockName, photons: NDArray[np.integer]) -> Pick:
    return Pick(block=block_id(block), photons=pack(photons))


def store(block: BlockName, cutoff_s: float | None) -> Step:
    """Return the step that stores a block; cut-off None: the memory's own, infinity: none."""
    return Step(store=StoreRequest(block=block_id(block), cutoff_s=cutoff_s))


def discard(block: BlockName) -> Step:
    return Step(discard=DiscardRequest(block=block_id(block)))
