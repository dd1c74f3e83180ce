"""Memories against density matrices, within 5 standard errors; the seed is 1."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import grpc
import numpy as np
import pytest
import uvloop
from dispatcher_network import (
    DELAY_NS,
    START_NS,
    Bench,
    Client,
    JumpingClock,
    ManualClock,
    block,
    configuration,
    running,
)
from five_sigma import within
from numpy.typing import NDArray

from dispatcher.devices.decay import Decay, decay
from dispatcher.layer.ownership import BlockName
from wire.dispatcher_pb2 import (
    AdjustMemoryRequest,
    CreateRequest,
    DiscardRequest,
    Feedback,
    StoreRequest,
)
from wire.outcomes import NO_CLICK
from wire.parameters.physics import BadParameter, Device, Memory, PairSource

COUNT = 40_000
GAMMA_WAIT_S = -np.log(0.7)  # damping of .3 for T1 = 1 s

Matrix = NDArray[np.complex128]
PHI_PLUS: Matrix = np.array([1, 0, 0, 1], dtype=np.complex128) / np.sqrt(2)
FLIP: Matrix = np.array([[0, 1], [1, 0]], dtype=np.complex128)
PHASE: Matrix = np.diag([1, -1]).astype(np.complex128)
BELL = [np.kron(pauli, np.eye(2)) @ PHI_PLUS for pauli in (np.eye(2), FLIP, PHASE, FLIP @ PHASE)]


def bell_probabilities(waited_s: float, t1_s: float, t2_s: float, begin: int = 0) -> list[float]:
    """Return how likely each Bell state is after both halves of one, Phi+, have waited."""
    kept, coherence = np.exp(-waited_s / t1_s), np.exp(-waited_s / t2_s)
    state = np.outer(BELL[begin], BELL[begin].conj()).reshape(2, 2, 2, 2)  # a b, a' b'
    for _ in (0, 1):  # decay the first qubit, then let the other be the first
        relaxed = state * np.array([[1, coherence], [coherence, kept]])[:, None, :, None]
        relaxed[0, :, 0, :] += (1 - kept) * state[1, :, 1, :]
        state = relaxed.transpose(1, 0, 3, 2)
    matrix = state.reshape(4, 4)
    return [float((bell.conj() @ matrix @ bell).real) for bell in BELL]


def run(
    folder: Path, act: Callable[[Bench, JumpingClock], Awaitable[None]], **memory: object
) -> None:
    """Run something where alice has such a memory."""

    async def inside() -> None:
        clock = JumpingClock()
        device = Device(memory=Memory(**memory))  # type: ignore[arg-type]
        config = configuration(folder, devices={"alice": device})
        async with running(config, clock) as bench:
            await act(bench, clock)

    uvloop.run(inside())


async def store(client: Client, half: int, number: int = 0) -> Feedback:
    """Store a block."""
    return await client.act(StoreRequest(block=block(number, half)))


def outcomes_after(folder: Path, waited_s: float, count: int, **memory: object) -> Feedback:
    """Let both halves of pairs wait in alice's memory; return what a Bell measurement tells."""
    found = []

    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(count)
        for half in (0, 1):
            await store(bench.alice, half)
        clock.time_ns += round(waited_s * 1e9)
        found.append(await bench.alice.bell_measure(block(0, 0), block(0, 1)))

    run(folder, act, **memory)
    return found[0]


def counts(feedback: Feedback) -> list[int]:
    """Return how many pairs were measured in each Bell state."""
    outcomes = np.frombuffer(feedback.outcomes, np.uint8)
    return [int(np.count_nonzero(outcomes == state)) for state in range(4)]


def test_a_memory_that_is_adjusted_decays_so_from_then_on(tmp_path: Path) -> None:
    async def act(bench: Bench, clock: JumpingClock) -> None:
        for number, t2_s in enumerate((1.0, 0.2)):
            request = AdjustMemoryRequest(node="alice", settings={"t2_s": t2_s})
            await bench.runner.call("AdjustMemory", request)
            await bench.alice.create(COUNT, number)
            for half in (0, 1):
                await store(bench.alice, half, number)
            clock.time_ns += 100_000_000
            found = await bench.alice.bell_measure(block(number, 0), block(number, 1))
            expected = bell_probabilities(0.1, 1.0, t2_s)
            assert all(within(n, COUNT, p) for n, p in zip(counts(found), expected, strict=True))

    run(tmp_path, act, t1_s=1.0, t2_s=0.5)


@pytest.mark.parametrize(
    ("caller", "node", "settings", "code", "text"),
    [
        ("alice", "alice", {"t2_s": 1.0}, "PERMISSION_DENIED", "only runner may"),
        ("runner", "nobody", {"t2_s": 1.0}, "NOT_FOUND", "nobody has no memory"),
        ("runner", "q1", {"t2_s": 1.0}, "NOT_FOUND", "q1 has no memory"),
        ("runner", "alice", {"t3_s": 1.0}, "INVALID_ARGUMENT", "has no t3_s"),
        ("runner", "alice", {"capacity": 1.0}, "INVALID_ARGUMENT", "has no capacity"),
        ("runner", "alice", {"t2_s": 0.0}, "INVALID_ARGUMENT", "t2_s 0.0: choose 1e-12 or more"),
        ("runner", "alice", {"t2_s": np.nan}, "INVALID_ARGUMENT", "t2_s nan: choose 1e-12 or"),
        ("runner", "alice", {"t2_s": 3.0}, "INVALID_ARGUMENT", "choose 1e-12 to 2 (twice t1_s)"),
        ("runner", "alice", {"efficiency": 2.0}, "INVALID_ARGUMENT", "2.0: choose 0 to 1"),
    ],
)
def test_a_memory_that_cannot_be_so_stays_as_it_was(
    tmp_path: Path, caller: str, node: str, settings: dict[str, float], code: str, text: str
) -> None:
    async def act(bench: Bench, _clock: JumpingClock) -> None:
        before = bench.layer.devices.of("alice")
        request = AdjustMemoryRequest(node=node, settings=settings)
        with pytest.raises(grpc.aio.AioRpcError) as refused:
            await getattr(bench, caller).call("AdjustMemory", request)
        assert refused.value.code().name == code
        assert text in str(refused.value.details())
        assert bench.layer.devices.of("alice") == before

    run(tmp_path, act, t1_s=1.0, t2_s=1.0)


def test_the_reference_gives_the_known_fidelity_of_two_sided_damping() -> None:
    assert bell_probabilities(GAMMA_WAIT_S, 1.0, 2.0)[0] == pytest.approx(0.7450)


@pytest.mark.parametrize(
    ("t1_s", "t2_s", "waited_s"), [(1.0, 1.0, 0.5), (1.0, 0.2, 0.1), (np.inf, 1.0, 0.7)]
)
def test_up_to_t2_of_t1_waiting_is_exact(
    tmp_path: Path, t1_s: float, t2_s: float, waited_s: float
) -> None:
    feedback = outcomes_after(tmp_path, waited_s, COUNT, t1_s=t1_s, t2_s=t2_s)
    assert feedback.exact
    expected = bell_probabilities(waited_s, t1_s, t2_s)
    assert sum(expected) == pytest.approx(1)
    assert all(within(n, COUNT, p) for n, p in zip(counts(feedback), expected, strict=True))


def test_a_plain_depolarising_memory_replaces_qubits_by_noise(tmp_path: Path) -> None:
    """Both halves of Phi+ for half its time: e^-1 of it is left, and a quarter of the rest."""
    feedback = outcomes_after(tmp_path, 0.5, COUNT, depolarizing_s=1.0)
    assert feedback.exact
    left = np.exp(-1)
    expected = [left + (1 - left) / 4, *[(1 - left) / 4] * 3]
    assert all(within(n, COUNT, p) for n, p in zip(counts(feedback), expected, strict=True))


def test_dephasing_and_depolarising_go_together(tmp_path: Path) -> None:
    feedback = outcomes_after(tmp_path, 0.5, COUNT, depolarizing_s=1.0, t2_s=2.0)
    left, flipped = np.exp(-1), (1 - np.exp(-0.5)) / 2
    phi = [left * (1 - flipped), left * flipped]
    found = counts(feedback)
    assert within(found[0], COUNT, phi[0] + (1 - left) / 4)
    assert within(found[2], COUNT, phi[1] + (1 - left) / 4)


def test_what_can_be_read_falls_with_time(tmp_path: Path) -> None:
    """Of either half e^(-.3 / .5), and .9 of it, whatever was looked into meanwhile."""
    feedback = outcomes_after(tmp_path, 0.3, COUNT, retrieval_s=0.5, efficiency=0.9)
    assert within(sum(counts(feedback)), COUNT, (0.9 * np.exp(-0.6)) ** 2)
    assert counts(feedback)[0] == sum(counts(feedback))


def test_noise_of_two_kinds_at_a_time_is_not_modelled() -> None:
    with pytest.raises(BadParameter, match=r"alice: depolarizing_s 1\.0 beside t1_s 2\.0"):
        Memory(t1_s=2.0, t2_s=1.0, depolarizing_s=1.0).check("alice")


def test_beyond_that_the_twirl_is_an_approximation(tmp_path: Path) -> None:
    feedback = outcomes_after(tmp_path, GAMMA_WAIT_S, COUNT, t1_s=1.0, t2_s=2.0)
    assert not feedback.exact
    found = counts(feedback)[0]
    assert within(found, COUNT, 0.7225)
    assert not within(found, COUNT, 0.7450)


@pytest.mark.parametrize("t2_s", [2.0, 1.5])
def test_state_vectors_follow_it_exactly(tmp_path: Path, t2_s: float) -> None:
    memory = {"t1_s": 1.0, "t2_s": t2_s, "damping": "dense"}
    feedback = outcomes_after(tmp_path, GAMMA_WAIT_S, COUNT, **memory)
    assert (feedback.exact, feedback.backend) == (True, "dense")
    expected = bell_probabilities(GAMMA_WAIT_S, 1.0, t2_s)
    assert all(within(n, COUNT, p) for n, p in zip(counts(feedback), expected, strict=True))


def test_a_block_too_large_for_state_vectors_is_refused_and_stays_stored(tmp_path: Path) -> None:
    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(1_300_000)
        await store(bench.alice, 0)
        clock.time_ns += 10**9
        with pytest.raises(grpc.aio.AioRpcError, match="amplitudes") as refused:
            await bench.alice.measure(block(0, 0))
        assert refused.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        status = await bench.runner.status()
        assert status.live_qubits == 2_600_000

    run(tmp_path, act, t1_s=1.0, t2_s=2.0, damping="dense")


def test_an_excited_qubit_relaxes_by_the_time_it_really_waited(tmp_path: Path) -> None:
    async def act(bench: Bench, clock: JumpingClock) -> None:
        for number, waited_s in enumerate((0.3, 2.0)):
            await bench.alice.create(COUNT, number, CreateRequest.ZEROS)
            await bench.alice.apply(block(number), b"\1" * COUNT)
            await store(bench.alice, 0, number)
            clock.time_ns += round(waited_s * 1e9)
            feedback = await bench.alice.measure(block(number))
            ones = np.frombuffer(feedback.outcomes, np.uint8).sum()
            assert within(int(ones), COUNT, np.exp(-waited_s))

    run(tmp_path, act, t1_s=1.0, t2_s=1.0)


def test_what_is_not_stored_decays_as_what_is(tmp_path: Path) -> None:
    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        clock.time_ns += 5 * 10**8
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        expected = bell_probabilities(0.5, 1.0, 0.4)
        assert all(within(n, COUNT, p) for n, p in zip(counts(found), expected, strict=True))

    run(tmp_path, act, t1_s=1.0, t2_s=0.4)


def test_a_block_that_is_used_waits_on_whether_or_not_it_is_stored_again(tmp_path: Path) -> None:
    """It meets the efficiency of its memory once, and the other half, not stored, likewise."""

    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        await store(bench.alice, 0)
        await bench.alice.apply(block(0, 0), b"\1" * COUNT)
        clock.time_ns += 5 * 10**8
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        expected = [0.9**2 * p for p in bell_probabilities(0.5, 1.0, 1.0, begin=1)]
        assert all(within(n, COUNT, p) for n, p in zip(counts(found), expected, strict=True))

    run(tmp_path, act, t1_s=1.0, t2_s=1.0, efficiency=0.9)


def test_storing_twice_goes_on_with_the_same_wait(tmp_path: Path) -> None:
    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        for _ in (0, 1):
            await store(bench.alice, 0)
            clock.time_ns += 5 * 10**8
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert within(counts(found)[2], COUNT, (1 - np.exp(-2)) / 2)  # both halves wait

    run(tmp_path, act, t2_s=1.0)


@pytest.mark.parametrize(
    "memory",
    [
        {"t2_s": 1.0},
        {"t1_s": 1.0, "t2_s": 1.0},
        {"t1_s": 1.0, "t2_s": 2.0, "damping": "dense"},
        {"depolarizing_s": 1.0},
        {"retrieval_s": 1.0},
    ],
    ids=["T2", "T1", "damping", "depolarising", "retrieval"],
)
def test_two_looks_at_half_a_time_are_one_wait_of_it(
    tmp_path: Path, memory: dict[str, float | str]
) -> None:
    """Each look has random numbers of its own: none of what it does is done or undone twice."""
    waited_s, left, depolarized = 0.6, 1.0, 0.0
    t1_s, t2_s = (float(memory.get(name, np.inf)) for name in ("t1_s", "t2_s"))
    if "retrieval_s" in memory:
        left = np.exp(-2 * waited_s)  # of both halves
    if "depolarizing_s" in memory:
        depolarized = 1 - np.exp(-2 * waited_s)
    expected = np.array(bell_probabilities(waited_s, t1_s, t2_s))
    expected = left * (expected * (1 - depolarized) + depolarized / 4)

    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        for half in (0, 1):
            await store(bench.alice, half)
        for _look in range(2):
            clock.time_ns += round(waited_s / 2 * 1e9)
            for half in (0, 1):
                (part,) = bench.layer.ownership.parts(BlockName(7, 0, half))
                bench.layer.memories.look_in(part)
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert all(within(n, COUNT, p) for n, p in zip(counts(found), expected, strict=True))

    run(tmp_path, act, **memory)


def test_storing_and_reading_loses_with_the_efficiency(tmp_path: Path) -> None:
    async def act(bench: Bench, _clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        await store(bench.alice, 0)
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert within(found.coincidences, COUNT, 0.8)
        assert (await bench.runner.status()).photons_lost == COUNT - found.coincidences

    run(tmp_path, act, efficiency=0.8)


def test_no_more_than_the_capacity_is_stored(tmp_path: Path) -> None:
    async def act(bench: Bench, _clock: JumpingClock) -> None:
        await bench.alice.create(60)
        await store(bench.alice, 0)
        with pytest.raises(
            grpc.aio.AioRpcError, match=r"60 more .* 60 stored .* memory, 100;"
        ) as no:
            await store(bench.alice, 1)
        assert no.value.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
        await bench.alice.measure(block(0, 0))
        await store(bench.alice, 1)

    run(tmp_path, act, capacity=100)


def test_a_memory_that_emits_keeps_its_own_halves_and_no_light_from_elsewhere(
    tmp_path: Path,
) -> None:
    async def act(bench: Bench, _clock: JumpingClock) -> None:
        await bench.bob.create(10)
        await bench.bob.send((block(0, 1), "bob-q9"))
        await bench.alice.receive(block(0, 1), "alice-q9")
        with pytest.raises(
            grpc.aio.AioRpcError, match=r"ABSORB is needed: alice .* let a station herald"
        ) as no:
            await store(bench.alice, 1)
        assert no.value.code() == grpc.StatusCode.FAILED_PRECONDITION
        await bench.alice.measure(block(0, 1))  # nothing has changed: it is still stored
        await bench.alice.create(10, number=1)
        await store(bench.alice, 0, number=1)

    run(tmp_path, act, kind="emissive")


def test_discarding_frees_the_memory(tmp_path: Path) -> None:
    async def act(bench: Bench, _clock: JumpingClock) -> None:
        await bench.alice.create(100)
        await store(bench.alice, 0)
        await bench.alice.discard(DiscardRequest(block=block(0, 0)))
        await store(bench.alice, 1)

    run(tmp_path, act, capacity=100)


def test_extra_pairs_photons_are_lost_with_the_efficiency_too(tmp_path: Path) -> None:
    async def act(bench: Bench, _clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        (part,) = bench.layer.ownership.parts(BlockName(7, 0, 0))
        part.pulses.extras = np.full(COUNT, 2, dtype=np.uint8)
        await store(bench.alice, 0)
        await bench.alice.apply(block(0, 0), b"\0" * COUNT)
        assert part.pulses.extras is not None
        assert within(int(part.pulses.extras.sum()), 2 * COUNT, 0.8)

    run(tmp_path, act, efficiency=0.8)


def test_a_block_that_is_sent_has_waited(tmp_path: Path) -> None:
    async def act(bench: Bench, clock: JumpingClock) -> None:
        await bench.alice.create(COUNT)
        await store(bench.alice, 0)
        clock.time_ns += 10**9
        for half in (0, 1):
            await bench.alice.send((block(0, half), "alice-q9"))
            await bench.bob.receive(block(0, half), "bob-q9")
        found = await bench.bob.bell_measure(block(0, 0), block(0, 1))
        assert within(counts(found)[2], COUNT, (1 - np.exp(-1)) / 2)

    run(tmp_path, act, t2_s=1.0)


def test_a_part_that_comes_later_has_not_waited_with_the_first(tmp_path: Path) -> None:
    """Of 400 photons 200 come to one port of bob's, and 100 to another after a switching."""

    async def inside() -> None:
        clock = ManualClock()
        devices = {"bob": Device(memory=Memory(t1_s=0.1, t2_s=0.1))}
        async with running(configuration(tmp_path, devices=devices), clock) as bench:
            connecting = asyncio.ensure_future(bench.switch.connect((1, 4)))
            await clock.waiters(1)
            await clock.set(START_NS + 101)
            await connecting
            await bench.charlie.create(400, state=CreateRequest.ZEROS)
            await bench.charlie.apply(block(), b"\1" * 400)
            sending = asyncio.ensure_future(bench.charlie.send((block(), "charlie-q0")))
            await clock.waiters(2)
            await clock.set(START_NS + 101 + DELAY_NS + 200)
            connecting = asyncio.ensure_future(bench.switch.connect((1, 5)))
            await clock.waiters(3)
            await clock.set(START_NS + 10_000)
            await asyncio.gather(connecting, sending)
            await bench.transport.landed()
            await bench.bob.receive(block(), "bob-q0")
            await store(bench.bob, 0)
            await clock.set(START_NS + 10**10)
            await bench.bob.receive(block(), "bob-q1")
            outcomes = list((await bench.bob.measure(block())).outcomes)
            assert outcomes == [0] * 200 + [NO_CLICK] * 100 + [1] * 100

    uvloop.run(inside())


def test_nothing_happens_to_qubits_in_an_ideal_memory() -> None:
    assert decay(Memory(), 1e9) == Decay()
    assert decay(Memory(t1_s=1.0, t2_s=1.0), 0.0) == Decay()


def test_pairs_of_a_source_decay_from_what_they_were(tmp_path: Path) -> None:
    """A source of F = .9 and dephasing by 1 - e^-1 on each half."""

    async def inside() -> None:
        clock = JumpingClock()
        device = Device(source=PairSource(fidelity=0.9), memory=Memory(t2_s=1.0))
        config = configuration(tmp_path, devices={"alice": device})
        async with running(config, clock) as bench:
            await bench.alice.create(COUNT)
            await store(bench.alice, 0)
            clock.time_ns += 10**9
            found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
            z = (1 - np.exp(-2)) / 2
            other = 0.1 / 3
            assert within(counts(found)[0], COUNT, 0.9 * (1 - z) + other * z)
            assert within(counts(found)[1], COUNT, other)

    uvloop.run(inside())


class SlowClock(JumpingClock):
    """A clock that goes on by a millisecond whenever it is read, as if all else took as long."""

    def now_ns(self) -> int:
        """Return the time."""
        self.time_ns += 1_000_000
        return self.time_ns


def test_replies_tell_the_wait_and_not_how_long_it_took_to_simulate(tmp_path: Path) -> None:
    log = tmp_path / "quantum.log"

    async def scene() -> int:
        config = configuration(tmp_path, event_log=str(log))
        async with running(config, SlowClock()) as bench:
            created = await bench.alice.create(10)
            await store(bench.alice, 0)
            applied = await bench.alice.apply(block(0, 0), bytes(10))
            return applied.time_ns - created.first_ns

    told_ns = uvloop.run(scene())
    (waited,) = (line for line in log.read_text().splitlines() if " recall " in line)
    # The memory reads the clock itself, right after the time of the reply.
    assert round(float(waited.split(" after ")[1].split()[0]) * 1e9) == told_ns + 1_000_000
