"""Requests of a host to the dispatcher, and those that are refused."""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import grpc
import uvloop
from dispatcher_network import (
    FAST_HZ,
    Bench,
    JumpingClock,
    block,
    configuration,
    running,
)

from wire.dispatcher_pb2 import (
    ApplyRequest,
    BellMeasureRequest,
    CreateRequest,
    DiscardRequest,
    Gate,
    GatherRequest,
    Launch,
    MeasureRequest,
    Pick,
    ReceiveRequest,
    ResendRequest,
    SendRequest,
    SplitRequest,
    StoreRequest,
)
from wire.positions import pack

Code = grpc.StatusCode
PREPARED = CreateRequest.PREPARED
MINE, THEIRS, ABSENT = block(0), block(1), block(99)


async def prepare(bench: Bench) -> None:
    """Give alice pairs 0 and zeros 2 and 3, bob pairs 1; leave block 4 at bob's port."""
    await bench.alice.create(4, number=0)
    await bench.bob.create(4, number=1)
    await bench.alice.create(4, number=2, state=CreateRequest.ZEROS)
    await bench.alice.create(5, number=3, state=CreateRequest.ZEROS)
    await bench.alice.create(4, number=4, state=CreateRequest.ZEROS)
    await bench.alice.send((block(4), "alice-q9"))


def launch(name: Any, port: str = "alice-q9", rate_hz: int = FAST_HZ) -> SendRequest:
    """Return the request that launches one block."""
    return SendRequest(launches=[Launch(block=name, port=port)], rate_hz=rate_hz)


def wait_for(port: str, timeout_s: float = 0.05) -> ReceiveRequest:
    """Return the request that waits for a block that does not come."""
    return ReceiveRequest(block=ABSENT, port=port, timeout_s=timeout_s)


def create(**fields: Any) -> CreateRequest:
    """Return the request that creates a block of a name that is free."""
    return CreateRequest(**{"session": 7, "number": 50, "count": 1, **fields})


def gates(*names: Gate.Name, target: Any = None) -> ApplyRequest:
    """Return the request that applies gates to alice's block."""
    return ApplyRequest(block=MINE, gates=[Gate(name=name, target=target) for name in names])


def gather(*picks: tuple[Any, list[int]], into: Any = None, keep: bool = False) -> GatherRequest:
    """Return the request that gathers photons, into a block of a name that is free."""
    every = [Pick(block=name, photons=pack(photons)) for name, photons in picks]
    return GatherRequest(into=into or block(50), picks=every, keep_rest=keep)


def turned(name: Gate.Name, angle_rad: float) -> ApplyRequest:
    """Return the request that flips alice's photons, then turns them by an angle."""
    turn = Gate(name=name, angle_rad=angle_rad)
    return ApplyRequest(block=MINE, paulis=bytes((1, 2, 3, 1)), gates=[Gate(name=Gate.H), turn])


def each_turned(name: Gate.Name, *angles_rad: float, angle_rad: float = 0.0) -> ApplyRequest:
    """Return the request that turns each of alice's photons by an angle of its own."""
    turn = Gate(name=name, angle_rad=angle_rad, angles_rad=angles_rad)
    return ApplyRequest(block=MINE, paulis=bytes((1, 2, 3, 1)), gates=[turn])


REFUSED = [
    # another's block, and one that is nowhere
    ("alice", ApplyRequest(block=THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    (
        "alice",
        ApplyRequest(block=ABSENT),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    ("alice", launch(THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    ("alice", launch(ABSENT), Code.PERMISSION_DENIED, "block 99/0.*not at alice"),
    ("alice", MeasureRequest(block=THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    (
        "alice",
        MeasureRequest(block=ABSENT),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    ("alice", StoreRequest(block=THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    (
        "alice",
        StoreRequest(block=ABSENT),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    ("alice", DiscardRequest(block=THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    (
        "alice",
        DiscardRequest(block=ABSENT),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    ("alice", gates(Gate.CX, target=THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    (
        "alice",
        BellMeasureRequest(first=MINE, second=THEIRS),
        Code.PERMISSION_DENIED,
        "not at alice",
    ),
    ("bob", ApplyRequest(block=block(4)), Code.PERMISSION_DENIED, "receive it first"),
    ("alice", gather((MINE, [0]), (THEIRS, [0])), Code.PERMISSION_DENIED, "not at alice"),
    ("bob", gather((block(4), [0])), Code.PERMISSION_DENIED, "receive it first"),
    (
        "alice",
        gather((MINE, [0]), (ABSENT, [0])),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    ("alice", ResendRequest(block=THEIRS), Code.PERMISSION_DENIED, "not at alice"),
    (
        "alice",
        ResendRequest(block=ABSENT),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    ("bob", ResendRequest(block=block(4)), Code.PERMISSION_DENIED, "receive it first"),
    ("alice", ResendRequest(block=MINE), Code.INVALID_ARGUMENT, "0 bytes for 4 photons"),
    (
        "alice",
        ResendRequest(block=MINE, bases=b"\0\xff\3\1"),
        Code.INVALID_ARGUMENT,
        r"bases\[2\] is 3",
    ),
    ("alice", SplitRequest(block=MINE, into=MINE), Code.ALREADY_EXISTS, "block 0/0"),
    ("alice", SplitRequest(block=THEIRS, into=ABSENT), Code.PERMISSION_DENIED, "not at"),
    (
        "alice",
        SplitRequest(block=ABSENT, into=MINE),
        Code.PERMISSION_DENIED,
        "block 99/0.*not at alice",
    ),
    # who may do what
    ("q1", SplitRequest(block=MINE, into=ABSENT), Code.PERMISSION_DENIED, "not a host"),
    ("q1", ResendRequest(block=MINE), Code.PERMISSION_DENIED, "not a host"),
    ("q1", gather((MINE, [0])), Code.PERMISSION_DENIED, "not a host"),
    ("runner", gather((MINE, [0])), Code.PERMISSION_DENIED, "not a host"),
    ("q1", create(), Code.PERMISSION_DENIED, "not a host"),
    ("runner", create(), Code.PERMISSION_DENIED, "not a host"),
    # ports
    ("alice", launch(MINE, port="alice-q7"), Code.NOT_FOUND, "alice-q0, alice-q9"),
    ("alice", launch(MINE, port="bob-q9"), Code.PERMISSION_DENIED, "belongs to bob"),
    ("alice", wait_for("bob-q9"), Code.PERMISSION_DENIED, "belongs to bob"),
    ("alice", wait_for("eth0"), Code.NOT_FOUND, "no port eth0"),
    ("alice", wait_for("alice-q0"), Code.DEADLINE_EXCEEDED, "block 99/0"),
    # arguments
    ("alice", create(number=0), Code.ALREADY_EXISTS, "block 0/0"),
    ("alice", create(count=0), Code.INVALID_ARGUMENT, "count 0"),
    ("alice", create(count=4_000_001), Code.INVALID_ARGUMENT, "count 4000001"),
    ("alice", create(state=5), Code.INVALID_ARGUMENT, "state 5"),
    (
        "alice",
        create(state=PREPARED, count=3, states=bytes(2)),
        Code.INVALID_ARGUMENT,
        "2 bytes for 3 photons",
    ),
    ("alice", create(state=PREPARED), Code.INVALID_ARGUMENT, "0 bytes for 1 photons"),
    (
        "alice",
        create(state=PREPARED, count=3, states=bytes((5, 6, 0))),
        Code.INVALID_ARGUMENT,
        r"states\[1\] is 6",
    ),
    ("alice", create(states=b"\1"), Code.INVALID_ARGUMENT, "1 states .* BELL_PAIRS"),
    (
        "alice",
        create(state=CreateRequest.ZEROS, states=b"\0"),
        Code.INVALID_ARGUMENT,
        "1 states .* ZEROS",
    ),
    (
        "alice",
        create(state=PREPARED, count=100, states=bytes(100)),
        Code.RESOURCE_EXHAUSTED,
        "limit of 100",
    ),
    ("alice", create(count=100), Code.RESOURCE_EXHAUSTED, "limit of 100"),
    (
        "alice",
        create(state=PREPARED, states=b"\0", state_dibits=b"\0"),
        Code.INVALID_ARGUMENT,
        "leave one of them out",
    ),
    (
        "alice",
        create(state=PREPARED, count=5, state_dibits=bytes(1)),
        Code.INVALID_ARGUMENT,
        "1 bytes for 5 numbers",
    ),
    (
        "alice",
        create(state=PREPARED, count=5, state_dibits=b"\0\4"),
        Code.INVALID_ARGUMENT,
        "behind the last of 5",
    ),
    (
        "alice",
        create(state_dibits=b"\1"),
        Code.INVALID_ARGUMENT,
        "1 states .* BELL_PAIRS",
    ),
    (
        "alice",
        ApplyRequest(block=MINE, paulis=bytes(4), dibits=bytes(1)),
        Code.INVALID_ARGUMENT,
        "leave one of them out",
    ),
    (
        "alice",
        ApplyRequest(block=MINE, dibits=bytes(2)),
        Code.INVALID_ARGUMENT,
        "2 bytes for 4 numbers",
    ),
    (
        "alice",
        ApplyRequest(block=block(3), dibits=b"\0\x04"),
        Code.INVALID_ARGUMENT,
        "behind the last of 5",
    ),
    (
        "alice",
        ApplyRequest(block=MINE, paulis=bytes(3)),
        Code.INVALID_ARGUMENT,
        "3 bytes for 4 photons",
    ),
    (
        "alice",
        ApplyRequest(block=MINE, paulis=bytes(5_000_000)),
        Code.INVALID_ARGUMENT,
        "5000000 bytes for 4 photons",
    ),
    (
        "alice",
        ApplyRequest(block=MINE, paulis=bytes((0, 4, 0, 0))),
        Code.INVALID_ARGUMENT,
        r"paulis\[1\] is 4",
    ),
    ("alice", gates(*[Gate.H] * 257), Code.INVALID_ARGUMENT, "257 gates"),
    (
        "alice",
        ApplyRequest(block=MINE, gates=[Gate(name=10)]),  # type: ignore[arg-type]
        Code.INVALID_ARGUMENT,
        "gate 10",
    ),
    ("alice", turned(Gate.RX, float("nan")), Code.INVALID_ARGUMENT, "angle_rad nan"),
    ("alice", turned(Gate.RY, float("-inf")), Code.INVALID_ARGUMENT, "angle_rad -inf"),
    ("alice", turned(Gate.RZ, 2e6), Code.INVALID_ARGUMENT, "angle_rad 2e[+]06"),
    ("alice", turned(Gate.T, 0.1), Code.INVALID_ARGUMENT, "T, which takes none"),
    (
        "alice",
        each_turned(Gate.RY, 0.1, 0.2, 0.3, 0.4),
        Code.INVALID_ARGUMENT,
        "with backend chp; start it with --backend dense",
    ),
    ("alice", each_turned(Gate.H, 0, 0, 0, 0), Code.INVALID_ARGUMENT, "takes none"),
    ("alice", each_turned(Gate.RX, 1, 2, 3), Code.INVALID_ARGUMENT, "3 for 4 photons"),
    (
        "alice",
        each_turned(Gate.RX, 1, float("nan"), 3, 4),
        Code.INVALID_ARGUMENT,
        "angle_rad nan",
    ),
    ("alice", each_turned(Gate.RX, 1, 2, 3, 2e6), Code.INVALID_ARGUMENT, "2e[+]06"),
    (
        "alice",
        each_turned(Gate.RX, 1, 2, 3, 4, angle_rad=1),
        Code.INVALID_ARGUMENT,
        "leave one of them out",
    ),
    ("alice", gates(Gate.CX, target=MINE), Code.INVALID_ARGUMENT, "named twice"),
    ("alice", gates(Gate.CZ, target=block(3)), Code.INVALID_ARGUMENT, "pair up"),
    ("alice", gates(Gate.H, Gate.CX), Code.PERMISSION_DENIED, "block 0/0 of session 0000"),
    (
        "alice",
        BellMeasureRequest(first=MINE, second=block(3)),
        Code.INVALID_ARGUMENT,
        "pair up",
    ),
    (
        "alice",
        BellMeasureRequest(first=MINE, second=MINE),
        Code.INVALID_ARGUMENT,
        "named twice",
    ),
    (
        "alice",
        MeasureRequest(block=MINE, bases=bytes((0, 1, 2, 5))),
        Code.INVALID_ARGUMENT,
        r"bases\[3\] is 5",
    ),
    (
        "alice",
        MeasureRequest(block=MINE, bases=bytes(4), basis_bits=bytes(1)),
        Code.INVALID_ARGUMENT,
        "leave one of them out",
    ),
    (
        "alice",
        MeasureRequest(block=MINE, basis_bits=bytes(2)),
        Code.INVALID_ARGUMENT,
        "2 bytes for 4 photons",
    ),
    (
        "alice",
        MeasureRequest(block=MINE, basis_bits=b"\x08"),
        Code.INVALID_ARGUMENT,
        "behind the last of 4",
    ),
    (
        "alice",
        MeasureRequest(block=MINE, basis=5),  # type: ignore[arg-type]
        Code.INVALID_ARGUMENT,
        "basis 5",
    ),
    ("alice", SendRequest(rate_hz=1), Code.INVALID_ARGUMENT, "no launches"),
    ("alice", launch(MINE, rate_hz=0), Code.INVALID_ARGUMENT, "rate_hz is 0"),
    (
        "alice",
        SendRequest(launches=[Launch(block=MINE, port="alice-q9")] * 2, rate_hz=1),
        Code.INVALID_ARGUMENT,
        "twice",
    ),
    ("alice", wait_for("alice-q0", 0), Code.INVALID_ARGUMENT, "timeout_s 0"),
    ("alice", DiscardRequest(), Code.INVALID_ARGUMENT, "either"),
    ("alice", gather(), Code.INVALID_ARGUMENT, "0 picks"),
    ("alice", gather(*[(MINE, [0])] * 4097), Code.INVALID_ARGUMENT, "4097 picks"),
    ("alice", gather((MINE, [])), Code.INVALID_ARGUMENT, "no photons"),
    ("alice", gather((MINE, [0]), (MINE, [1])), Code.INVALID_ARGUMENT, "twice"),
    ("alice", gather((MINE, [3, 1, 2, 1])), Code.INVALID_ARGUMENT, "name 1 twice"),
    (
        "alice",
        gather((MINE, [0]), (block(2), [0, 4])),
        Code.INVALID_ARGUMENT,
        r"photons of block 2/0 of .*\[1\] is 4",
    ),
    (
        "alice",
        gather((MINE, [4_294_967_295])),
        Code.INVALID_ARGUMENT,
        "4294967295; count 4 photons",
    ),
    (
        "alice",
        gather((MINE, [0]), into=block(0, 1)),
        Code.ALREADY_EXISTS,
        "block 0/1 .* exists",
    ),
    (
        "alice",
        gather((MINE, [0]), into=MINE, keep=True),
        Code.ALREADY_EXISTS,
        "block 0/0 .* exists",
    ),
]


def attempt(folder: Path, action: Callable[[Bench], Awaitable[None]], **changes: Any) -> None:
    """Run an action against a dispatcher."""

    async def run() -> None:
        async with running(configuration(folder, **changes), JumpingClock()) as bench:
            await action(bench)

    uvloop.run(run())
