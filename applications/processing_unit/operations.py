"""Operations on single qubits of a host, many of which are done in one call."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import islice

from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.steps import block_id, discard, gather, store
from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    Gate,
    MeasureRequest,
    Pick,
    ResendRequest,
    Step,
)
from wire.outcomes import Pauli
from wire.positions import pack


class Kind(Enum):
    """An operation on the qubit of a block, alone or with that of the target."""

    ZERO = "zero"  # a new qubit in |0>
    X = "X"
    Y = "Y"
    Z = "Z"
    H = "H"
    S = "S"
    S_DAG = "S_DAG"
    T = "T"
    RX = "RX"  # by angle_rad: exp(-i angle/2 P)
    RY = "RY"
    RZ = "RZ"
    CX = "CX"  # from the block to the target
    CZ = "CZ"
    MEASURE = "measure"  # in the basis Z; the qubit is used up
    OBSERVE = "observe"  # the same, and the qubit stays in the state that was found
    STORE = "store"  # into memory, where it decoheres until it is used
    TAKE = "take"  # a photon (`position`) of a block into the target, which is new
    DISCARD = "discard"


OUTCOMES = (Kind.MEASURE, Kind.OBSERVE)  # the kinds that have one


@dataclass(frozen=True)
class Operation:
    """One operation; every block but one that is taken from holds one qubit."""

    kind: Kind
    block: BlockName
    target: BlockName | None = None
    angle_rad: float = 0.0
    position: int = 0


GATES = frozenset(kind for kind in Kind if kind.value in Gate.Name.DESCRIPTOR.values_by_name)
PAULIS = {Kind.X: Pauli.X, Kind.Z: Pauli.Z, Kind.Y: Pauli.XZ}
MAX_GATES = 256  # in one step
MAX_STEPS = 64  # in one order
IN_Z = bytes([MeasureRequest.Z])


async def process(qnic: Qnic, operations: Sequence[Operation]) -> list[int]:
    """Do operations on single qubits at this host, one after the other.

    Return the outcome of each measurement: 0 or 1, 255 where no detector clicked. If one
    fails, those before it are done, and those behind it are not.
    """
    outcomes = b""
    for order in _orders(steps_of(operations)):
        outcomes += b"".join(feedback.outcomes for feedback in await qnic.perform(*order))
    assert len(outcomes) == sum(operation.kind in OUTCOMES for operation in operations)
    return list(outcomes)


def _orders(coming: Iterator[Step]) -> Iterator[tuple[Step, ...]]:
    """Yield as many steps as an order may have, until there are no more."""
    while order := tuple(islice(coming, MAX_STEPS)):
        yield order


def steps_of(operations: Iterable[Operation]) -> Iterator[Step]:
    gates: list[Operation] = []
    for operation in operations:
        is_gate = operation.kind in GATES
        if gates and (not is_gate or operation.block != gates[0].block or len(gates) == MAX_GATES):
            yield _applied(gates)
            gates = []
        if is_gate:
            gates.append(operation)
        else:
            yield _step(operation)
    if gates:
        yield _applied(gates)


def _applied(gates: list[Operation]) -> Step:
    return Step(apply=ApplyRequest(block=block_id(gates[0].block), gates=map(_gate, gates)))


def _gate(operation: Operation) -> Gate:
    gate = Gate(name=operation.kind.value, angle_rad=operation.angle_rad)
    if operation.target is not None:
        gate.target.CopyFrom(block_id(operation.target))
    return gate


def _step(operation: Operation) -> Step:
    name, block = operation.block, block_id(operation.block)
    match operation.kind:
        case Kind.ZERO:
            state = CreateRequest.ZEROS
            create = CreateRequest(session=name.session, number=name.number, count=1, state=state)
            return Step(create=create)
        case Kind.MEASURE:
            return Step(measure=MeasureRequest(block=block, basis=MeasureRequest.Z))
        case Kind.OBSERVE:
            return Step(resend=ResendRequest(block=block, bases=IN_Z))
        case Kind.STORE:
            # An application keeps its qubits, however old.
            return store(name, math.inf)
        case Kind.TAKE:
            assert operation.target is not None
            taken = Pick(block=block, photons=pack([operation.position]))
            return gather(operation.target, [taken], keep_rest=True)
        case Kind.DISCARD:
            return discard(name)
        case pauli:
            return Step(apply=ApplyRequest(block=block, paulis=bytes([PAULIS[pauli]])))
