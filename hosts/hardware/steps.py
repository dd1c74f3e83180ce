"""Operations on single qubits as steps of the dispatcher's orders."""

import math
from collections.abc import Iterable, Iterator

from hosts.hardware.operations import Kind, Operation
from hosts.hardware.requests import block_id
from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    DiscardRequest,
    Gate,
    GatherRequest,
    MeasureRequest,
    Pick,
    ResendRequest,
    Step,
    StoreRequest,
)
from wire.outcomes import Pauli

GATES = frozenset(kind for kind in Kind if kind.value in Gate.Name.DESCRIPTOR.values_by_name)
PAULIS = {Kind.X: Pauli.X, Kind.Z: Pauli.Z, Kind.Y: Pauli.XZ}
MAX_GATES = 256  # in one step
IN_Z = bytes([MeasureRequest.Z])


def steps_of(operations: Iterable[Operation]) -> Iterator[Step]:
    """Yield steps, gates in a row on one qubit in a step together."""
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
            # What an application has, it keeps, however old.
            return Step(store=StoreRequest(block=block, cutoff_s=math.inf))
        case Kind.TAKE:
            assert operation.target is not None
            pick = Pick(block=block, photons=[operation.position])
            into = block_id(operation.target)
            return Step(gather=GatherRequest(into=into, picks=[pick], keep_rest=True))
        case Kind.DISCARD:
            return Step(discard=DiscardRequest(block=block))
        case pauli:
            return Step(apply=ApplyRequest(block=block, paulis=bytes([PAULIS[pauli]])))
