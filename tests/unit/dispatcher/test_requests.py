"""The rights of each caller, and that a refused request changes nothing."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import grpc
import pytest
import uvloop
from dispatcher_network import (
    FAST_HZ,
    START_NS,
    Bench,
    Client,
    JumpingClock,
    block,
    configuration,
    running,
)
from limits import SOON_S, until

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
    StatusRequest,
    StoreRequest,
)

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
    every = [Pick(block=name, photons=photons) for name, photons in picks]
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


@pytest.mark.parametrize(("node", "request_", "code", "message"), REFUSED)
def test_refused_requests_say_why_and_change_nothing(
    tmp_path: Path, node: str, request_: Any, code: grpc.StatusCode, message: str
) -> None:
    async def action(bench: Bench) -> None:
        await prepare(bench)
        before = await bench.runner.status()
        client = Client(bench.stub, f"token of {node}")
        with pytest.raises(grpc.aio.AioRpcError, match=message) as refusal:
            await client.act(request_)
        assert refusal.value.code() == code
        assert await bench.runner.status() == before
        # All is as it was: alice's photons are still hers and still Phi+.
        assert (await bench.alice.bell_measure(block(0, 0), block(0, 1))).outcomes == bytes(4)

    attempt(tmp_path, action, max_live_qubits=100)


def test_an_emission_longer_than_switches_remember_is_refused(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(31)
        with pytest.raises(grpc.aio.AioRpcError, match="take 31 s") as refusal:
            await bench.alice.act(launch(MINE, rate_hz=1))
        assert refusal.value.code() == Code.INVALID_ARGUMENT

    attempt(tmp_path, action)


@pytest.mark.parametrize("token", ["", "token of eve", "token of alice "])
def test_a_wrong_token_is_unauthenticated(tmp_path: Path, token: str) -> None:
    async def action(bench: Bench) -> None:
        client = Client(bench.stub, token)
        # Of a stream that has messages the client may hear that it could not write them.
        stream = bench.stub.Perform(iter(()), metadata=client.metadata, timeout=SOON_S)
        for reply in (stream.read(), client.status()):
            with pytest.raises(grpc.aio.AioRpcError) as refusal:
                await reply
            assert refusal.value.code() == Code.UNAUTHENTICATED
        assert (await bench.runner.status()).events == 0

    attempt(tmp_path, action)


def test_a_call_without_a_token_is_unauthenticated(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        with pytest.raises(grpc.aio.AioRpcError, match="no token") as refusal:
            await bench.stub.Status(StatusRequest(), timeout=SOON_S)
        assert refusal.value.code() == Code.UNAUTHENTICATED

    attempt(tmp_path, action)


def test_a_block_that_was_sent_belongs_to_its_receiver_alone(tmp_path: Path) -> None:
    """Its sender cannot find out by asking whether its receiver has measured it."""

    async def action(bench: Bench) -> None:
        await bench.alice.create(4)
        await bench.alice.send((MINE, "alice-q9"))
        await bench.bob.receive(MINE, "bob-q9")
        answers = []
        for _ in range(2):
            with pytest.raises(grpc.aio.AioRpcError) as refusal:
                await bench.alice.measure(MINE)
            answers.append((refusal.value.code(), refusal.value.details()))
            if len(answers) == 1:
                assert (await bench.bob.measure(MINE)).clicks == 4
        assert answers[0] == answers[1]
        assert answers[0][0] == Code.PERMISSION_DENIED
        with pytest.raises(grpc.aio.AioRpcError, match="not at bob") as refusal:
            await bench.bob.measure(MINE)
        assert refusal.value.code() == Code.PERMISSION_DENIED

    attempt(tmp_path, action)


def test_discarding_a_session_takes_what_is_at_the_node_and_its_ports(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await prepare(bench)
        await bench.bob.act(create(session=8, count=3))
        dropped = await bench.bob.discard(DiscardRequest(session=7))
        assert dropped.photons == 4 + 4 + 4  # both halves of 1, and 4 at the port
        assert (await bench.bob.measure(block(50, session=8))).clicks == 3
        dropped = await bench.bob.discard(DiscardRequest(session=7))
        assert dropped.photons == 0

    attempt(tmp_path, action)


def test_clifford_gates_apply_in_order_after_the_paulis(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await prepare(bench)
        # X, then H S S H = X again: |0> for all, and with CX nothing is flipped.
        names = (Gate.H, Gate.S, Gate.S, Gate.H)
        request = ApplyRequest(
            block=block(2),
            paulis=bytes((1, 1, 1, 0)),
            gates=[*(Gate(name=name) for name in names), Gate(name=Gate.CX, target=block(0, 1))],
        )
        await bench.alice.act(request)
        assert (await bench.alice.measure(block(2))).outcomes == bytes((0, 0, 0, 1))
        measured = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert measured.outcomes == bytes((0, 0, 0, 1))

    attempt(tmp_path, action)


def test_bases_may_differ_from_photon_to_photon(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(300)
        bases = bytes(range(3)) * 100
        ours = await bench.alice.act(MeasureRequest(block=block(0, 0), bases=bases))
        theirs = await bench.alice.act(MeasureRequest(block=block(0, 1), bases=bases))
        agree = [a == b for a, b in zip(ours.outcomes, theirs.outcomes, strict=True)]
        assert agree == [True, True, False] * 100

    attempt(tmp_path, action)


def test_feedback_carries_times_and_clicks(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(11, state=CreateRequest.ZEROS)
        await bench.alice.send((MINE, "alice-q9"))
        received = await bench.bob.receive(MINE, "bob-q9")
        assert (received.first_ns, received.last_ns) == (START_NS + 49, START_NS + 59)
        measured = await bench.bob.measure(MINE)
        assert (measured.first_ns, measured.last_ns) == (received.first_ns, received.last_ns)
        assert (measured.photons, measured.clicks, measured.outcomes) == (11, 11, bytes(11))

    attempt(tmp_path, action)


def test_a_block_as_large_as_allowed_passes(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(4_000_000)
        await bench.alice.apply(MINE, bytes([2]) * 4_000_000)
        measured = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert measured.outcomes == bytes([2]) * 4_000_000

    # A share of one in three for alice.
    attempt(tmp_path, action, max_live_qubits=3 * 8_000_000)


def test_a_caller_that_goes_away_leaves_nothing_behind(tmp_path: Path) -> None:
    async def action(bench: Bench) -> None:
        # A caller that is still waiting, so that the other must have been seen to leave.
        leaving, staying = (
            asyncio.ensure_future(bench.bob.receive(MINE, "bob-q9")) for _ in range(2)
        )
        waiting = bench.transport._waiting
        await until(lambda: sum(map(len, waiting.values())) == 2)
        leaving.cancel()
        await until(lambda: sum(map(len, waiting.values())) == 1)
        await bench.alice.create(3)
        await bench.alice.send((MINE, "alice-q9"))
        assert (await staying).photons == 3
        assert not waiting

    attempt(tmp_path, action)


def test_an_unexpected_error_is_reported_to_end_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(1)
        monkeypatch.delattr(bench.layer.sabot, "_store")
        with pytest.raises(grpc.aio.AioRpcError) as failure:
            await bench.alice.measure(MINE)
        assert failure.value.code() == Code.UNKNOWN
        (error,) = cast(BaseExceptionGroup, bench.errors.pop()).exceptions  # of orders side by side
        assert isinstance(error, AttributeError)

    attempt(tmp_path, action)


def test_an_unexpected_error_in_flight_is_reported_to_end_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def action(bench: Bench) -> None:
        await bench.alice.create(1)
        monkeypatch.delattr(bench.layer.network, "switches")
        await bench.alice.send((MINE, "alice-q9"))
        assert isinstance(bench.errors.pop(), AttributeError)

    attempt(tmp_path, action)
