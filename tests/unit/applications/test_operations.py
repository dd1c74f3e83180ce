"""Operations on single qubits as the steps of the dispatcher's orders."""

import math
from itertools import product

import pytest

from applications.processing_unit.operations import GATES, MAX_GATES, Kind, Operation, steps_of
from hosts.hardware.block_name import BlockName
from hosts.hardware.steps import block_id
from wire.dispatcher_pb2 import CreateRequest, Gate, MeasureRequest, Step
from wire.positions import pack

ONE, OTHER = BlockName(1, 2, 0), BlockName(1, 3, 1)
PAULIS = {Kind.X: 1, Kind.Z: 2, Kind.Y: 3}  # as wire/dispatcher.proto numbers them


def gates_of(step: Step) -> list[str]:
    """Return the gates of a step, or what else it is."""
    words = [Gate.Name.Name(gate.name) for gate in step.apply.gates]
    return words or [str(step.WhichOneof("operation"))]


def test_gates_on_one_block_are_one_step_and_all_else_is_one_of_its_own() -> None:
    done = [
        *(Operation(Kind.H, ONE), Operation(Kind.S, ONE), Operation(Kind.CX, ONE, OTHER)),
        *(Operation(Kind.T, OTHER), Operation(Kind.MEASURE, ONE), Operation(Kind.X, ONE)),
        *(Operation(Kind.RX, OTHER, angle_rad=0.25), Operation(Kind.RZ, OTHER, angle_rad=-1.5)),
    ]
    steps = list(steps_of(done))
    assert list(map(gates_of, steps)) == [
        *(["H", "S", "CX"], ["T"], ["measure"], ["apply"], ["RX", "RZ"])
    ]
    blocks = [block_id(name) for name in (ONE, OTHER, ONE, OTHER)]
    assert [step.apply.block for step in steps if step.HasField("apply")] == blocks
    assert [gate.HasField("target") for gate in steps[0].apply.gates] == [False, False, True]
    assert steps[0].apply.gates[2].target == block_id(OTHER)
    assert [gate.angle_rad for gate in steps[4].apply.gates] == [0.25, -1.5]


@pytest.mark.parametrize(("number", "sizes"), [(0, []), (1, [1]), (256, [256]), (257, [256, 1])])
def test_a_step_has_so_many_gates_at_most(number: int, sizes: list[int]) -> None:
    assert MAX_GATES == 256
    steps = steps_of([Operation(Kind.H, ONE)] * number)
    assert [len(step.apply.gates) for step in steps] == sizes


def test_every_kind_is_a_gate_of_the_dispatcher_or_a_step_of_its_own() -> None:
    assert {kind.value for kind in GATES} == set(Gate.Name.keys()) - {"T_DAG"}
    target = {Kind.TAKE: OTHER, Kind.CX: OTHER, Kind.CZ: OTHER}
    for kind in Kind:
        (step,) = steps_of([Operation(kind, ONE, target.get(kind), position=4)])
        assert bool(step.apply.gates) == (kind in GATES), kind
        if kind in PAULIS:
            assert step.apply.paulis == bytes([PAULIS[kind]])


def test_what_is_no_gate_says_all_of_it() -> None:
    kinds = (Kind.ZERO, Kind.MEASURE, Kind.OBSERVE, Kind.STORE, Kind.TAKE, Kind.DISCARD)
    done = [Operation(kind, ONE, OTHER, position=4) for kind in kinds]
    zero, measure, observe, store, take, discard = steps_of(done)
    create = CreateRequest(session=1, number=2, count=1, state=CreateRequest.ZEROS)
    assert zero.create == create
    assert (measure.measure.block, measure.measure.basis) == (block_id(ONE), MeasureRequest.Z)
    assert (observe.resend.block, observe.resend.bases) == (block_id(ONE), b"\0")
    assert (store.store.block, store.store.cutoff_s) == (block_id(ONE), math.inf)
    assert take.gather.into == block_id(OTHER)
    assert [(pick.block, pick.photons) for pick in take.gather.picks] == [
        (block_id(ONE), pack([4]))
    ]
    assert take.gather.keep_rest
    assert discard.discard.block == block_id(ONE)


@pytest.mark.parametrize(("first", "second"), [*product((Kind.H, Kind.MEASURE), repeat=2)])
def test_operations_stay_in_their_order(first: Kind, second: Kind) -> None:
    words = {Kind.H: "H", Kind.MEASURE: "measure"}
    steps = steps_of([Operation(first, ONE), Operation(second, ONE)])
    assert [word for step in steps for word in gates_of(step)] == [words[first], words[second]]
