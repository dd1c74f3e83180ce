"""Light through fibres and switches, over a real gRPC server with real clients."""

import asyncio
from dataclasses import replace
from pathlib import Path

import grpc
import numpy as np
import pytest
import uvloop
from dispatcher_network import (
    DELAY_NS,
    START_NS,
    Bench,
    JumpingClock,
    ManualClock,
    block,
    configuration,
    running,
    with_fibers,
)
from limits import SOON_S

from dispatcher.layer.network import Network
from dispatcher.layer.ownership import BlockName
from wire.config import BadConfig, DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import ApplyRequest, BellMeasureRequest, CreateRequest, Feedback

PATHS = (1, 3), (2, 4), (3, 5)  # charlie to alice, charlie to bob, alice to bob
NO_CLICK = 255


async def superdense_coding(bench: Bench, paulis: bytes, packed: bool = False) -> list[int]:
    """Send one Pauli for each pair from alice to bob, packed or not; return the outcomes."""
    await bench.switch.connect(*PATHS)
    await bench.charlie.create(len(paulis))
    await bench.charlie.send((block(half=0), "charlie-q0"), (block(half=1), "charlie-q1"))
    await bench.alice.receive(block(half=0), "alice-q0")
    if packed:
        request = ApplyRequest(block=block(half=0), dibits=two_bits_each(paulis))
        await bench.alice.act(request)
    else:
        await bench.alice.apply(block(half=0), paulis)
    await bench.alice.send((block(half=0), "alice-q0"))
    await bench.bob.receive(block(half=0), "bob-q1")
    await bench.bob.receive(block(half=1), "bob-q0")
    measure = BellMeasureRequest(first=block(half=0), second=block(half=1), packed=packed)
    feedback = await bench.bob.act(measure)
    outcomes = unpacked(feedback) if packed else list(feedback.outcomes)
    seen = len(paulis) - outcomes.count(NO_CLICK)
    assert (feedback.photons, feedback.coincidences) == (len(paulis), seen)
    return outcomes


def two_bits_each(paulis: bytes) -> bytes:
    numbers = np.frombuffer(paulis, np.uint8)
    bits = np.stack([numbers & 1, numbers >> 1], axis=1)
    return np.packbits(bits, bitorder="little").tobytes()


def unpacked(feedback: Feedback) -> list[int]:
    assert not feedback.outcomes
    packed = np.frombuffer(feedback.dibits, np.uint8)
    bits = np.unpackbits(packed, count=2 * feedback.photons, bitorder="little")
    missed = np.unpackbits(np.frombuffer(feedback.missed, np.uint8)).tolist()
    states: list[int] = (bits[::2] + 2 * bits[1::2]).tolist()
    gone = [place for place, bit in enumerate(missed) if bit]
    for place in gone:
        states[place] = NO_CLICK
    return states


def sdc_run(
    config: DispatcherConfig, paulis: bytes, packed: bool = False
) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return the outcomes of superdense coding in a network of its own."""

    async def run() -> list[int]:
        async with running(config, JumpingClock()) as bench:
            outcomes = await superdense_coding(bench, paulis, packed)
            status = await bench.runner.status()
            assert (status.live_qubits, status.live_bytes) == (0, 0)
            assert status.pairs_created == len(paulis)
            return outcomes

    return np.array(uvloop.run(run()))


def test_superdense_coding_carries_two_bits_a_photon(tmp_path: Path) -> None:
    paulis = bytes(range(4)) * 50
    assert bytes(sdc_run(configuration(tmp_path), paulis).tolist()) == paulis


@pytest.mark.parametrize("pairs", [1, 4, 201])
def test_two_bits_a_photon_can_be_packed(tmp_path: Path, pairs: int) -> None:
    paulis = (bytes(range(4)) * 51)[-pairs:]
    assert bytes(sdc_run(configuration(tmp_path), paulis, packed=True).tolist()) == paulis


def test_what_is_lost_is_told_packed_as_it_is_byte_by_byte(tmp_path: Path) -> None:
    paulis = np.random.default_rng(3).integers(0, 4, 1001, np.uint8).tobytes()
    lossy = with_fibers(configuration(tmp_path), length_km=1, loss_db_per_km=0.5)
    one, other = (sdc_run(lossy, paulis, packed) for packed in (False, True))
    assert (one == NO_CLICK).any()
    assert one.tolist() == other.tolist()


def test_rotation_of_a_switch_adds_up_over_its_paths(tmp_path: Path) -> None:
    # Three passages of XZ: two on one photon, one on the other.
    config = configuration(tmp_path, switches=[QuantumSwitch("q1", rotation=3)])
    assert sdc_run(config, bytes(8)).tolist() == [3] * 8


def test_depolarizing_gives_symbol_errors_as_it_should(tmp_path: Path) -> None:
    count, p = 40_000, 0.1
    config = configuration(tmp_path)
    noisy = [replace(f, depolarizing=p if f.b.port == "2" else 0) for f in config.fibers]
    outcomes = sdc_run(replace(config, fibers=noisy), bytes(count))
    expected = 3 * p / 4
    errors = int((outcomes != 0).sum())
    assert abs(errors - count * expected) < 5 * (count * expected * (1 - expected)) ** 0.5


def test_loss_of_fibers_and_switch_multiplies(tmp_path: Path) -> None:
    count = 40_000
    config = configuration(tmp_path, switches=[QuantumSwitch("q1", insertion_loss_db=0.1)])
    outcomes = sdc_run(with_fibers(config, length_km=1, loss_db_per_km=0.2), bytes(count))
    # Six fibres, three passages of the switch, and 2 km in which bob's half waits for alice's.
    expected = 10 ** (-(6 * 0.2 + 3 * 0.1 + 2 * 0.2) / 10)
    coincidences = int((outcomes != NO_CLICK).sum())
    assert abs(coincidences - count * expected) < 5 * (count * expected * (1 - expected)) ** 0.5
    assert not outcomes[outcomes != NO_CLICK].any()


def test_light_needs_its_time_through_the_fiber(tmp_path: Path) -> None:
    async def run() -> None:
        config = with_fibers(configuration(tmp_path), length_km=20.4)
        async with running(config, JumpingClock()) as bench:
            await bench.alice.create(101)
            sent = await bench.alice.send((block(), "alice-q9"), rate_hz=1_000_000)
            assert (sent.first_ns, sent.last_ns) == (START_NS, START_NS + 100_000)
            received = await bench.bob.receive(block(), "bob-q9")
            assert received.first_ns - sent.first_ns == 100_000
            assert received.last_ns - sent.last_ns == 100_000
            assert sent.time_ns >= received.last_ns

    uvloop.run(run())


def test_send_replies_when_the_last_photon_has_left_and_not_before(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            await bench.alice.create(1001)
            sending = asyncio.ensure_future(bench.alice.send((block(), "alice-q9")))
            await clock.waiters(2)
            await clock.set(START_NS + 1000)
            await bench.runner.status()
            assert not sending.done()
            await clock.set(START_NS + 1001)
            await sending
            assert not bench.layer.ownership.parts(BlockName(7, 0, 0))[0].node

    uvloop.run(run())


async def cut_in_the_middle(bench: Bench, clock: ManualClock, *then: tuple[int, int]) -> None:
    """Send 1000 photons at 1 GHz and change the path when 500 have passed the switch."""
    connecting = asyncio.ensure_future(bench.switch.connect((1, 3)))
    await clock.waiters(1)
    await clock.set(START_NS + 101)
    await connecting
    await bench.charlie.create(1000)
    sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
    await clock.waiters(2)
    await clock.set(START_NS + 101 + DELAY_NS + 500)
    connecting = asyncio.ensure_future(bench.switch.connect(*then))
    await clock.waiters(3)
    await clock.set(START_NS + 10_000)
    await asyncio.gather(connecting, sending)
    await bench.transport.landed()


async def first_part_at(bench: Bench, port: str) -> None:
    """Return when a part of the block has come to a port, and those that wait for it could know."""
    async with asyncio.timeout(SOON_S):
        while True:
            parts = bench.layer.ownership.parts(BlockName(7, 0, 0))
            if any(part.port == port for part in parts):
                break
            await bench.runner.status()
    for _ in range(3):
        await bench.runner.status()


def outcomes_present(outcomes: bytes) -> list[int]:
    """Return the positions of the photons that clicked."""
    return [position for position, outcome in enumerate(outcomes) if outcome != NO_CLICK]


def test_a_path_that_closes_cuts_the_block(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            await cut_in_the_middle(bench, clock)
            received = await bench.alice.receive(block(), "alice-q0")
            assert received.photons == 1000
            measured = await bench.alice.measure(block())
            assert measured.clicks == 500
            assert outcomes_present(measured.outcomes) == list(range(500))
            assert (await bench.runner.status()).photons_lost == 500

    uvloop.run(run())


def test_a_path_that_moves_divides_the_block(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            await cut_in_the_middle(bench, clock, (1, 4))
            await bench.alice.receive(block(), "alice-q0")
            await bench.bob.receive(block(), "bob-q0")
            # A part is flipped without a change of the other's photons.
            await bench.alice.apply(block(), bytes([1]) * 1000)
            ours = await bench.alice.measure(block())
            theirs = await bench.bob.measure(block())
            partner = await bench.charlie.measure(block(half=1))
            # The switch is dark for the 100 ns that it needs.
            assert outcomes_present(ours.outcomes) == list(range(500))
            assert outcomes_present(theirs.outcomes) == list(range(600, 1000))
            assert partner.clicks == 1000
            for position, outcome in enumerate(partner.outcomes):
                if position < 500:
                    assert ours.outcomes[position] != outcome
                elif position >= 600:
                    assert theirs.outcomes[position] == outcome

    uvloop.run(run())


def test_who_waits_for_a_block_has_the_parts_that_come_later_too(tmp_path: Path) -> None:
    """The second part goes round by 10 km of fibre, which takes some 49,000 ns."""
    config = configuration(tmp_path)
    round_by = Fiber(FiberEnd("q1", "6"), FiberEnd("q1", "7"), length_km=10)
    config.fibers.append(round_by)

    async def run() -> None:
        clock = ManualClock()
        async with running(config, clock) as bench:
            waiting = asyncio.ensure_future(bench.alice.receive(block(), "alice-q0"))
            sending = asyncio.ensure_future(cut_in_the_middle(bench, clock, (1, 6), (7, 3)))
            await first_part_at(bench, "alice-q0")
            assert not waiting.done()
            await clock.waiters(1)
            await clock.set(START_NS + 200_000)
            await sending
            assert (await waiting).photons == 1000
            measured = await bench.alice.measure(block())
            assert outcomes_present(measured.outcomes) == [*range(500), *range(600, 1000)]

    uvloop.run(run())


def test_parts_that_come_to_two_ports_of_a_node_are_one_block_again(tmp_path: Path) -> None:
    async def run() -> None:
        clock = ManualClock()
        async with running(configuration(tmp_path), clock) as bench:
            connecting = asyncio.ensure_future(bench.switch.connect((1, 4)))
            await clock.waiters(1)
            await clock.set(START_NS + 101)
            await connecting
            await bench.charlie.create(400)
            sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
            await clock.waiters(2)
            await clock.set(START_NS + 101 + DELAY_NS + 200)
            connecting = asyncio.ensure_future(bench.switch.connect((1, 5)))
            await clock.waiters(3)
            await clock.set(START_NS + 10_000)
            await asyncio.gather(connecting, sending)
            await bench.transport.landed()
            await bench.bob.receive(block(), "bob-q0")
            await bench.bob.receive(block(), "bob-q1")
            ours = await bench.bob.measure(block())
            assert outcomes_present(ours.outcomes) == [*range(200), *range(300, 400)]

    uvloop.run(run())


def test_light_that_meets_no_path_never_arrives(tmp_path: Path) -> None:
    async def run() -> None:
        async with running(configuration(tmp_path), JumpingClock()) as bench:
            await bench.charlie.create(10)
            sent = await bench.charlie.send((block(), "charlie-q0"))
            assert sent.photons == 10
            with pytest.raises(grpc.aio.AioRpcError) as refusal:
                await bench.alice.receive(block(), "alice-q0", timeout_s=0.05)
            assert refusal.value.code() == grpc.StatusCode.DEADLINE_EXCEEDED
            assert "alice-q0" in str(refusal.value.details())
            status = await bench.runner.status()
            assert (status.live_qubits, status.photons_lost) == (10, 10)
            assert [event.kind for event in bench.layer.history._events][-1] == "dark"

    uvloop.run(run())


@pytest.mark.parametrize("loss_db_per_km", [0.0, 1.0])
def test_who_sends_is_answered_when_light_has_left_and_sees_no_loss_before_news_is_back(
    tmp_path: Path, loss_db_per_km: float
) -> None:
    """The last of 1000 photons leaves after 999 ns; 2,000 km take 9.8 ms there, and back."""
    there_ns = round(2_000e3 / 2.04e8 * 1e9)
    fibers = {"length_km": 2_000.0, "loss_db_per_km": loss_db_per_km}
    config = with_fibers(configuration(tmp_path), **fibers)

    async def run() -> None:
        clock = ManualClock()
        async with running(config, clock) as bench:
            await bench.charlie.create(1000)
            sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
            await clock.waiters(2)
            await clock.set(START_NS + 999)
            await bench.runner.status()
            assert not sending.done()
            await clock.set(START_NS + 1000)
            report = await sending
            assert (report.first_ns, report.last_ns) == (START_NS, START_NS + 999)
            assert (report.time_ns, report.photons) == (START_NS + 1000, 1000)
            for time_ns in (START_NS + 999 + there_ns, START_NS + 999 + 2 * there_ns):
                await clock.waiters(1)
                await clock.set(time_ns)
                await bench.runner.status()
                assert "dark" not in [event.kind for event in bench.layer.history._events]
                await clock.set(time_ns + 1)
            await bench.transport.landed()
            assert [event.kind for event in bench.layer.history._events][-1] == "dark"

    uvloop.run(run())


def test_light_goes_through_several_switches(tmp_path: Path) -> None:
    async def run() -> None:
        config = configuration(tmp_path)
        fibers = [
            Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("q1", "1"), length_km=1),
            Fiber(FiberEnd("q1", "2"), FiberEnd("q2", "7"), length_km=2),
            Fiber(FiberEnd("q2", "8"), FiberEnd("bob", "bob-q0"), length_km=3),
        ]
        switches = [QuantumSwitch("q1", rotation=1), QuantumSwitch("q2", rotation=2)]
        config = replace(config, fibers=fibers, switches=switches)
        async with running(config, JumpingClock()) as bench:
            bench.layer.network.switches["q2"].timeline.connect({7: 8}, START_NS - 1000)
            await bench.switch.connect((1, 2))
            await bench.alice.create(4)
            sent = await bench.alice.send((block(), "alice-q0"))
            received = await bench.bob.receive(block(), "bob-q0")
            assert received.first_ns - sent.first_ns == 4902 + 9804 + 14706
            await bench.bob.send((block(), "bob-q0"))  # and it does not come back: one way
            assert (await bench.runner.status()).photons_lost == 4

    uvloop.run(run())


def test_light_in_a_ring_of_cross_connects_fades(tmp_path: Path) -> None:
    async def run() -> None:
        config = configuration(tmp_path)
        ring = Fiber(FiberEnd("q1", "10"), FiberEnd("q1", "11"), length_km=0.1)
        config = replace(config, fibers=[*config.fibers, ring])
        clock = ManualClock()
        async with running(config, clock) as bench:
            connecting = asyncio.ensure_future(bench.switch.connect((3, 10), (11, 11)))
            await clock.waiters(1)
            await clock.set(START_NS + 101)
            await connecting
            await bench.alice.create(2, state=CreateRequest.ZEROS)
            sending = asyncio.ensure_future(bench.alice.send((block(), "alice-q0")))
            await clock.waiters(2)
            await clock.set(START_NS + 101 + DELAY_NS + 2)
            await sending
            closing = asyncio.ensure_future(bench.switch.connect((10, 10), (11, 11)))
            await clock.waiters(2)
            await clock.set(START_NS + 1_000_000)
            await closing
            await bench.transport.landed()
            status = await bench.runner.status()
            assert (status.live_qubits, status.photons_lost) == (0, 2)

    uvloop.run(run())


def test_the_order_of_arrival_does_not_change_what_photons_meet(tmp_path: Path) -> None:
    async def run(numbers: list[int], folder: Path) -> list[bytes]:
        folder.mkdir()
        config = with_fibers(configuration(folder), loss_db_per_km=100.0, depolarizing=0.3)
        async with running(config, JumpingClock()) as bench:
            await bench.alice.create(50, number=0)
            await bench.alice.create(50, number=1)
            for number in numbers:
                await bench.alice.send((block(number), "alice-q9"))
            found = {}
            for number in reversed(numbers):
                await bench.bob.receive(block(number), "bob-q9")
                found[number] = (await bench.bob.measure(block(number))).outcomes
            return [found[0], found[1]]

    forwards, backwards = (
        uvloop.run(run(order, tmp_path / name)) for order, name in (([0, 1], "a"), ([1, 0], "b"))
    )
    assert forwards == backwards
    assert forwards[0] != forwards[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"a": FiberEnd("bob", "bob-q0")}, "two fibres end in port bob-q0"),
        ({"b": FiberEnd("q1", "east")}, "not a port number"),
        ({"length_km": -1.0}, "length_km -1.0: choose 0 to 2000"),
        ({"loss_db_per_km": -0.1}, "loss_db_per_km -0.1: choose 0 to 1000"),
        ({"depolarizing": 1.5}, "depolarizing 1.5: choose 0 to 1"),
    ],
)
def test_a_fiber_that_cannot_be_is_refused(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    fiber = Fiber(FiberEnd("alice", "alice-q7"), FiberEnd("bob", "bob-q7"))
    fibers = [*configuration(tmp_path).fibers, replace(fiber, **changes)]  # type: ignore[arg-type]
    with pytest.raises(BadConfig, match=message):
        Network(fibers, [QuantumSwitch("q1")])
