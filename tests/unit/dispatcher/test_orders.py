"""Perform: many orders in one call, each a sequence of steps."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import grpc
import pytest
import uvloop
from dispatcher_network import (
    FAST_HZ,
    Bench,
    JumpingClock,
    ManualClock,
    block,
    configuration,
    running,
)
from limits import SOON_S

from dispatcher.operations.limits import MAX_ORDERS
from dispatcher.server.servicer import Orders
from wire.dispatcher_pb2 import (
    ApplyRequest,
    BellMeasureRequest,
    CreateRequest,
    DiscardRequest,
    Feedback,
    Gate,
    GatherRequest,
    Launch,
    MeasureRequest,
    Order,
    Outcome,
    ReceiveRequest,
    SendRequest,
    Step,
)
from wire.positions import pack


class Host:
    """One host's call of Perform."""

    def __init__(self, bench: Bench, node: str) -> None:
        self.call = bench.stub.Perform(metadata=getattr(bench, node).metadata, timeout=SOON_S)

    async def order(self, number: int, *steps: Step, **how: Any) -> None:
        await self.call.write(Order(number=number, steps=steps, **how))

    async def cancel(self, number: int) -> None:
        await self.call.write(Order(number=number, cancel=True))

    async def outcome(self) -> Outcome:
        outcome = await asyncio.wait_for(self.call.read(), SOON_S)
        assert isinstance(outcome, Outcome)
        return outcome


def create(count: int, number: int = 0) -> Step:
    return Step(create=CreateRequest(session=7, number=number, count=count))


def receive(port: str, half: int = 0, timeout_s: float = 5.0, number: int = 0) -> Step:
    name = block(number, half)
    return Step(receive=ReceiveRequest(block=name, port=port, timeout_s=timeout_s))


def bell(number: int = 0) -> Step:
    first, second = block(number), block(number, half=1)
    return Step(bell_measure=BellMeasureRequest(first=first, second=second))


def send(*launches: tuple[int, str], number: int = 0) -> Step:
    ways = [Launch(block=block(number, half), port=port) for half, port in launches]
    return Step(send=SendRequest(launches=ways, rate_hz=FAST_HZ))


def on(folder: Path, act: Callable[[Bench], Awaitable[None]], clock: Any = None) -> None:
    async def run() -> None:
        async with running(configuration(folder), clock or JumpingClock()) as bench:
            await act(bench)

    uvloop.run(run())


def test_superdense_coding_takes_one_order_of_each_host(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.switch.connect((1, 3), (3, 5), (2, 4))
        charlie, alice, bob = (Host(bench, node) for node in ("charlie", "alice", "bob"))
        apply = Step(apply=ApplyRequest(block=block(), paulis=bytes([0, 1, 2, 3])))
        bell = Step(bell_measure=BellMeasureRequest(first=block(), second=block(half=1)))
        await bob.order(1, receive("bob-q1"), receive("bob-q0", half=1), bell)
        await alice.order(1, receive("alice-q0"), apply, send((0, "alice-q0")))
        await charlie.order(1, create(4), send((0, "charlie-q0"), (1, "charlie-q1")))
        outcome = await bob.outcome()
        assert (outcome.number, outcome.code, len(outcome.feedbacks)) == (1, 0, 3)
        assert outcome.feedbacks[-1].outcomes == bytes([0, 1, 2, 3])

    on(tmp_path, act)


def test_a_round_of_purification_is_one_order(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        steps = [create(6)]
        for number, photons in ((1, [4, 2, 0]), (2, [1, 3, 5])):
            request = GatherRequest(into=block(number), keep_rest=number == 1)
            request.picks.add(block=block(), photons=pack(photons))
            steps.append(Step(gather=request))
        gate = Gate(name=Gate.CX, target=block(2))
        steps.append(Step(apply=ApplyRequest(block=block(1), gates=[gate])))
        steps.append(Step(measure=MeasureRequest(block=block(2))))
        await alice.order(1, *steps)
        outcome = await alice.outcome()
        assert (outcome.code, len(outcome.feedbacks)) == (0, 5)
        photons = [feedback.photons for feedback in outcome.feedbacks]
        assert photons == [6, 3, 3, 3, 3]

    on(tmp_path, act)


def test_orders_run_side_by_side(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        await alice.order(1, receive("alice-q0"))  # nothing comes
        await alice.order(2, create(1))
        assert (await alice.outcome()).number == 2

    on(tmp_path, act)


def test_the_step_that_fails_ends_its_order_and_those_before_it_stand(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        discard = Step(discard=DiscardRequest(block=block(number=9)))
        await alice.order(1, create(3), discard, create(3, number=1))
        outcome = await alice.outcome()
        assert outcome.code == grpc.StatusCode.PERMISSION_DENIED.value[0]
        assert "block 9/0" in outcome.text
        assert not outcome.feedbacks
        assert (await bench.runner.status()).live_qubits == 6
        await alice.order(1, Step(measure=MeasureRequest(block=block())))
        assert (await alice.outcome()).code == 0

    on(tmp_path, act)


def test_a_cancelled_order_ends_and_its_number_is_free_again(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        await alice.order(1, receive("alice-q0", timeout_s=60))
        await alice.order(2, create(1))
        await alice.outcome()
        await alice.cancel(1)
        await alice.cancel(5)  # of no order
        await alice.order(3, create(1, number=1))
        assert (await alice.outcome()).number == 3
        await alice.order(1, create(1, number=2))
        assert (await alice.outcome()).number == 1

    on(tmp_path, act)


def test_light_that_comes_after_its_session_was_let_go_leaves_nothing(tmp_path: Path) -> None:
    clock = ManualClock()

    async def act(bench: Bench) -> None:
        await bench.switch.connect((1, 3))
        charlie, alice = Host(bench, "charlie"), Host(bench, "alice")
        await charlie.order(1, create(4), send((0, "charlie-q0")))
        await clock.waiters(1)
        await alice.order(1, Step(discard=DiscardRequest(session=7)))
        await alice.outcome()
        await clock.set(clock.now_ns() + 1_000_000)
        await charlie.outcome()
        assert (await bench.runner.status()).live_qubits == 4  # charlie's other halves

    async def run() -> None:
        async with running(configuration(tmp_path), clock) as bench:
            connecting = asyncio.create_task(act(bench))
            await clock.waiters(1)
            await clock.set(clock.now_ns() + 1_000)  # the path opens
            await connecting

    uvloop.run(run())


@pytest.mark.parametrize(
    ("steps", "words"),
    [([], "0 steps"), ([Step()], "without an operation"), ([Step()] * 65, "65 steps")],
)
def test_an_order_that_asks_for_nothing_or_too_much_is_refused(
    tmp_path: Path, steps: list[Step], words: str
) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        await alice.order(1, *steps)
        outcome = await alice.outcome()
        assert outcome.code == grpc.StatusCode.INVALID_ARGUMENT.value[0]
        assert words in outcome.text

    on(tmp_path, act)


def test_orders_that_follow_each_other_do_so_and_only_the_last_one_is_answered(
    tmp_path: Path,
) -> None:
    clock = ManualClock()

    async def act(bench: Bench) -> None:
        charlie = Host(bench, "charlie")
        quiet = {"follows": True, "quiet": True}
        for number in range(3):
            light = send((0, "charlie-q0"), (1, "charlie-q1"), number=number)
            await charlie.order(7, create(4, number), light, **quiet)
        await charlie.order(7, follows=True)
        for number in range(3):
            while (created := (await bench.runner.status()).pairs_created) <= 4 * number:
                await asyncio.sleep(0)
            assert created == 4 * (number + 1)  # one block flies, and no other
            await clock.waiters(2)  # its two halves
            await clock.set(clock.now_ns() + 1_000_000)
        outcome = await charlie.outcome()
        assert (outcome.number, outcome.code, len(outcome.feedbacks)) == (7, 0, 0)

    on(tmp_path, act, clock)


def test_a_quiet_order_that_fails_is_heard_of(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        await alice.order(7, create(1), follows=True, quiet=True)
        await alice.order(7, create(1), follows=True, quiet=True)
        await alice.order(7, create(1, number=1), follows=True)
        outcomes = [await alice.outcome(), await alice.outcome()]
        exists = grpc.StatusCode.ALREADY_EXISTS.value[0]
        assert [(outcome.number, outcome.code) for outcome in outcomes] == [(7, exists), (7, 0)]

    on(tmp_path, act)


def test_an_order_is_repeated_for_the_blocks_that_follow(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.switch.connect((1, 3), (3, 5), (2, 4))
        charlie, alice, bob = (Host(bench, node) for node in ("charlie", "alice", "bob"))
        first = receive("bob-q1", number=5), receive("bob-q0", half=1, number=5)
        await bob.order(1, *first, bell(5), times=3)
        for number, paulis in ((5, [0, 1, 2, 3]), (6, [3, 3]), (7, [2])):
            light = send((0, "charlie-q0"), (1, "charlie-q1"), number=number)
            await charlie.order(number, create(len(paulis), number), light)
            apply = Step(apply=ApplyRequest(block=block(number), paulis=bytes(paulis)))
            back = send((0, "alice-q0"), number=number)
            await alice.order(number, receive("alice-q0", number=number), apply, back)
            outcome = await bob.outcome()
            assert (outcome.number, outcome.code) == (1, 0)
            assert outcome.feedbacks[-1].outcomes == bytes(paulis)
        await bob.order(1, create(1))  # it was the last time: the number is free
        assert (await bob.outcome()).code == 0

    on(tmp_path, act)


def test_a_repeated_order_ends_where_there_is_no_light(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        bob = Host(bench, "bob")
        steps = receive("bob-q1", timeout_s=0.01), receive("bob-q0", half=1), bell()
        await bob.order(1, *steps, times=3)
        assert (await bob.outcome()).code == grpc.StatusCode.DEADLINE_EXCEEDED.value[0]
        await bob.order(1, create(1))
        assert (await bob.outcome()).code == 0

    on(tmp_path, act)


@pytest.mark.parametrize(
    ("steps", "times", "words"),
    [
        ([create(1)], 2, "a step that cannot be repeated; repeat receive and bell_measure alone"),
        ([bell()], 65, "65 times; send at most 64 in an order"),
    ],
)
def test_what_cannot_be_repeated_is_refused(
    tmp_path: Path, steps: list[Step], times: int, words: str
) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        await alice.order(1, *steps, times=times)
        outcome = await alice.outcome()
        assert outcome.code == grpc.StatusCode.INVALID_ARGUMENT.value[0]
        assert outcome.text == words
        assert (await bench.runner.status()).live_qubits == 0

    on(tmp_path, act)


def test_a_number_that_is_still_in_use_is_refused(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        alice = Host(bench, "alice")
        for _ in range(2):
            await alice.order(1, receive("alice-q0", timeout_s=60))
        outcome = await alice.outcome()
        assert outcome.code == grpc.StatusCode.INVALID_ARGUMENT.value[0]
        assert "order 1 is still running" in outcome.text

    on(tmp_path, act)


@pytest.mark.parametrize("node", ["switch", "runner"])
def test_only_hosts_give_orders(tmp_path: Path, node: str) -> None:
    async def act(bench: Bench) -> None:
        with pytest.raises(grpc.aio.AioRpcError, match="is not a host"):
            await Host(bench, node).outcome()

    on(tmp_path, act)


def test_a_host_that_goes_away_in_mid_order_does_no_harm(tmp_path: Path) -> None:
    clock = ManualClock()

    async def act(bench: Bench) -> None:
        charlie = Host(bench, "charlie")
        await charlie.order(1, create(1), send((0, "charlie-q0")))
        await clock.waiters(1)
        charlie.call.cancel()
        await clock.set(clock.now_ns() + 1_000_000)
        await Host(bench, "alice").order(1, create(1, number=5))
        assert (await bench.runner.status()).live_qubits > 0

    on(tmp_path, act, clock)


class SlowHost:
    """A host that reads no outcome before it is let; what it orders is done at once."""

    def __init__(self) -> None:
        self.done = 0
        self.outcomes: list[Outcome] = []
        self.reads, self.is_written_to = asyncio.Event(), asyncio.Event()
        self.orders: asyncio.Queue[Order | None] = asyncio.Queue()

    async def act(self, _kind: str, _request: object) -> Feedback:
        self.done += 1
        return Feedback()

    async def settled(self) -> None:
        pass

    async def write(self, outcome: Outcome) -> None:
        self.is_written_to.set()
        await self.reads.wait()
        self.outcomes.append(outcome)

    async def each(self) -> AsyncIterator[Order]:
        while (order := await self.orders.get()) is not None:
            yield order


def test_a_host_that_reads_no_outcomes_has_so_many_orders_and_no_more() -> None:
    async def run() -> None:
        host = SlowHost()
        for number in range(1, MAX_ORDERS + 1):
            host.orders.put_nowait(Order(number=number, steps=[create(1)]))
        async with asyncio.timeout(SOON_S):
            running = asyncio.create_task(
                Orders(host.act, host.write, host.settled).run(host.each())
            )
            while host.done < MAX_ORDERS:
                await asyncio.sleep(0)
            host.orders.put_nowait(Order(number=MAX_ORDERS + 1, steps=[create(1)]))
            while not host.orders.empty():
                await asyncio.sleep(0)
            host.orders.put_nowait(None)
            host.reads.set()
            await running
        codes = {outcome.number: outcome.code for outcome in host.outcomes}
        assert host.done == MAX_ORDERS
        exhausted = grpc.StatusCode.RESOURCE_EXHAUSTED.value[0]
        assert [number for number, code in codes.items() if code == exhausted] == [MAX_ORDERS + 1]
        assert len(codes) == MAX_ORDERS + 1

    asyncio.run(run())


def test_an_outcome_is_written_whole_though_its_order_is_cancelled_meanwhile() -> None:
    async def run() -> None:
        host = SlowHost()
        async with asyncio.timeout(SOON_S):
            running = asyncio.create_task(
                Orders(host.act, host.write, host.settled).run(host.each())
            )
            host.orders.put_nowait(Order(number=1, steps=[create(1)]))
            await host.is_written_to.wait()
            host.orders.put_nowait(Order(number=1, cancel=True))
            host.orders.put_nowait(Order(number=2, steps=[create(1)]))
            host.orders.put_nowait(None)
            while host.done < 2:
                await asyncio.sleep(0)
            host.reads.set()
            await running
        assert [outcome.number for outcome in host.outcomes] == [1, 2]

    asyncio.run(run())


def test_an_order_that_is_cancelled_while_it_is_answered_is_not_repeated() -> None:
    async def run() -> None:
        host = SlowHost()
        async with asyncio.timeout(SOON_S):
            running = asyncio.create_task(
                Orders(host.act, host.write, host.settled).run(host.each())
            )
            host.orders.put_nowait(Order(number=1, steps=[bell()], times=3))
            await host.is_written_to.wait()
            host.orders.put_nowait(Order(number=1, cancel=True))
            while not host.orders.empty():
                await asyncio.sleep(0)
            host.reads.set()
            host.orders.put_nowait(Order(number=2, steps=[bell()]))
            host.orders.put_nowait(None)
            await running
        assert [outcome.number for outcome in host.outcomes] == [1, 2]

    asyncio.run(run())


class Lights:
    """A host whose light comes when the test says so, and the outcomes that it hears."""

    def __init__(self) -> None:
        self.here, self.landed, self.outcomes = asyncio.Event(), asyncio.Event(), list[Outcome]()

    async def act(self, kind: str, _request: Any) -> Feedback:
        await {"receive": self.here, "send": self.landed}[kind].wait()
        return Feedback()

    async def settled(self) -> None:
        pass

    async def write(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)

    async def orders(self, turns: int) -> AsyncIterator[Order]:
        """Wait for light and send it on; report turns of the loop later that it is lost."""
        yield Order(number=1, steps=[receive("alice-q0"), send((0, "alice-q0"))])
        for _turn in range(turns):
            await asyncio.sleep(0)
        yield Order(number=1, lost=True)
        for _turn in range(20):
            await asyncio.sleep(0)
        self.landed.set()


@pytest.mark.parametrize("turns", [0, 20])
@pytest.mark.parametrize("here", [False, True])
def test_an_order_ends_with_light_that_is_lost_but_goes_on_with_what_it_has(
    turns: int, here: bool
) -> None:
    async def run() -> None:
        host = Lights()
        if here:
            host.here.set()
        async with asyncio.timeout(SOON_S):
            await Orders(host.act, host.write, host.settled).run(host.orders(turns))
        (outcome,) = host.outcomes
        expired = grpc.StatusCode.DEADLINE_EXCEEDED.value[0]
        assert (outcome.code, len(outcome.feedbacks)) == ((0, 2) if here else (expired, 0))

    asyncio.run(run())


def test_light_that_is_said_to_be_lost_may_be_received_later(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.switch.connect((1, 3), (3, 5), (2, 4))
        charlie, alice = Host(bench, "charlie"), Host(bench, "alice")
        await alice.order(1, receive("alice-q0"))
        await alice.call.write(Order(number=1, lost=True))
        assert (await alice.outcome()).code == grpc.StatusCode.DEADLINE_EXCEEDED.value[0]
        await charlie.order(1, create(4), send((0, "charlie-q0"), (1, "charlie-q1")))
        assert (await charlie.outcome()).code == 0
        await alice.order(1, receive("alice-q0"))
        assert (await alice.outcome()).feedbacks[0].photons == 4

    on(tmp_path, act)
