"""The devices of hosts in a running dispatcher, within 5 standard errors; the seed is 1."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from pathlib import Path

import grpc
import numpy as np
import pytest
import uvloop
from dispatcher_network import Bench, JumpingClock, block, configuration, running
from five_sigma import within

from dispatcher.build import build_layer
from dispatcher.layer.ownership import BlockName
from wire.config import BadConfig
from wire.dispatcher_pb2 import (
    ApplyRequest,
    CreateRequest,
    Feedback,
    Gate,
    MeasureRequest,
    StoreRequest,
)
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Compensator,
    Detectors,
    Device,
    Memory,
    PairSource,
)

COUNT = 100_000
EVERYTHING = {
    "charlie": Device(PairSource("thermal", 0.5, 0.95, jitter_ps=100.0)),
    "alice": Device(memory=Memory(t1_s=1e-3, t2_s=5e-4, efficiency=0.9)),
    "bob": Device(
        detectors=Detectors(0.8, 1e5, 1e-9, 50e-9, 0.05, 1e-7, 50.0),
        analyser=BellAnalyser("linear", 0.95, 1e9, 1e-9),
    ),
}


def run(
    folder: Path, act: Callable[[Bench], Awaitable[None]], devices: dict[str, Device]
) -> list[str]:
    """Run something in a network with these devices; return the event log."""

    async def inside() -> None:
        config = configuration(folder, devices=devices, event_log=str(folder / "events"))
        async with running(config, JumpingClock()) as bench:
            await act(bench)

    uvloop.run(inside())
    return (folder / "events").read_text().splitlines()


async def distribute(bench: Bench, number: int = 0, count: int = COUNT) -> None:
    """Bring both halves of charlie's pairs to bob."""
    await bench.switch.connect((1, 4), (2, 5))
    await bench.charlie.create(count, number)
    ways = [(block(number, half), f"charlie-q{half}") for half in (0, 1)]
    await bench.charlie.send(*ways, rate_hz=50_000_000)
    for half in (0, 1):
        await bench.bob.receive(block(number, half), f"bob-q{half}")


def created(log: list[str]) -> str:
    """Return the event of a block's creation."""
    return next(line for line in log if " create " in line)


def shares(feedback: Feedback) -> list[int]:
    """Count the outcomes of a Bell measurement."""
    outcomes = np.frombuffer(feedback.outcomes, np.uint8)
    return [int((outcomes == state).sum()) for state in range(4)]


def test_bell_measurements_find_what_a_werner_source_emits(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await distribute(bench)
        found = await bench.bob.bell_measure(block(0, 0), block(0, 1))
        assert found.exact
        expected = (0.91, 0.03, 0.03, 0.03)
        assert all(within(n, COUNT, p) for n, p in zip(shares(found), expected, strict=True))

    log = run(tmp_path, act, {"charlie": Device(PairSource(fidelity=0.91))})
    assert "Bell pairs, Phi+=" in created(log)


def test_only_the_source_of_the_host_that_makes_them_counts(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.alice.create(COUNT)
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert shares(found) == [COUNT, 0, 0, 0]

    run(tmp_path, act, {"charlie": Device(PairSource(fidelity=0.5))})


def test_pulses_without_pairs_are_dark_and_more_pairs_are_an_approximation(
    tmp_path: Path,
) -> None:
    """All pairs of a pulse are Phi+ and tell it; that their photons interfere is left out."""

    async def act(bench: Bench) -> None:
        await distribute(bench)
        found = await bench.bob.bell_measure(block(0, 0), block(0, 1))
        assert not found.exact
        assert within(found.coincidences, COUNT, 1 - np.exp(-0.5))
        assert shares(found)[0] == found.coincidences
        status = await bench.runner.status()
        assert abs(status.pairs_created - 0.5 * COUNT) < 5 * (0.5 * COUNT) ** 0.5
        assert status.photons_lost == 0

    log = run(tmp_path, act, {"charlie": Device(PairSource("poisson", 0.5))})
    assert " in weak pulses" in created(log)
    assert "double=" not in log[-1]


@pytest.mark.parametrize("basis", [MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y])
def test_detectors_look_at_single_photons_too(tmp_path: Path, basis: MeasureRequest.Basis) -> None:
    async def act(bench: Bench) -> None:
        await distribute(bench)
        found = [
            np.frombuffer((await bench.bob.measure(block(0, half), basis)).outcomes, np.uint8)
            for half in (0, 1)
        ]
        both = (found[0] != 255) & (found[1] != 255)
        assert within(int(both.sum()), COUNT, 0.6**2)
        differ = int((found[0] != found[1])[both].sum())
        assert differ == (both.sum() if basis == MeasureRequest.Y else 0)

    run(tmp_path, act, {"bob": Device(detectors=Detectors(efficiency=0.6))})


def test_what_happened_to_the_photons_is_in_the_event_log(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await distribute(bench)
        await bench.bob.bell_measure(block(0, 0), block(0, 1))

    last = run(tmp_path, act, EVERYTHING)[-1]
    assert "bell-measure" in last
    for incident in ("distinguishable", "dark", "afterpulses", "dead", "double", "accidental"):
        assert f" {incident}=" in last, incident
    assert "Phi-=" not in last


def test_the_same_seed_gives_the_same_outcomes_whatever_the_order(tmp_path: Path) -> None:
    bob = Device(detectors=Detectors(0.8, 1e6), analyser=BellAnalyser(visibility=0.9))
    devices = {"charlie": EVERYTHING["charlie"], "bob": bob}

    def outcomes(order: Sequence[int]) -> dict[int, bytes]:
        found: dict[int, bytes] = {}

        async def act(bench: Bench) -> None:
            for number in order:
                await distribute(bench, number, 1_000)
            for number in reversed(order):
                pair = block(number, 0), block(number, 1)
                found[number] = (await bench.bob.bell_measure(*pair)).outcomes

        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        run(folder, act, devices)
        return found

    first = outcomes((0, 1, 2))
    assert first == outcomes((2, 0, 1)) == outcomes((0, 1, 2))
    assert len(set(first.values())) == 3


@pytest.mark.parametrize("waits", [False, True])
def test_detectors_are_live_again_by_the_time_light_comes(tmp_path: Path, waits: bool) -> None:
    """Two photons a quarter of a second apart, or more than one if the second is stored."""
    bob = Device(detectors=Detectors(dead_time_s=0.5))

    async def act(bench: Bench) -> None:
        clock = bench.layer.clock
        assert isinstance(clock, JumpingClock)
        found = []
        for number in (0, 1):
            await bench.alice.create(1, number, CreateRequest.ZEROS)
        for number in (0, 1):
            await bench.alice.send((block(number), "alice-q9"), rate_hz=1_000)
            await bench.bob.receive(block(number), "bob-q9")
            if waits:
                await bench.bob.act(StoreRequest(block=block(number)))
                clock.time_ns += 10**9 * number
            found.append((await bench.bob.measure(block(number))).clicks)
            clock.time_ns += 25 * 10**7
        assert found == [1, int(waits)]

    run(tmp_path, act, {"bob": bob})


def test_pairs_of_different_pulses_do_not_come_at_the_same_time(tmp_path: Path) -> None:
    """Of a normal difference of rms s, 68.27 % are within s."""
    window_s = 100e-12 * 2**0.5
    alice = Device(
        PairSource(jitter_ps=100.0), analyser=BellAnalyser(coincidence_window_s=window_s)
    )

    async def act(bench: Bench) -> None:
        for number in range(3):
            await bench.alice.create(COUNT, number)
        same = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert same.coincidences == COUNT
        swapped = await bench.alice.bell_measure(block(1, 1), block(2, 0))
        assert within(swapped.coincidences, COUNT, 0.6826895)

    run(tmp_path, act, {"alice": alice})


def turn(bench: Bench, angle_rad: float) -> None:
    """Turn half 0 about Z, as drift on its way does."""
    (part,) = bench.layer.ownership.parts(BlockName(7, 0, 0))
    before = part.pulses.angles_rad
    part.pulses.angles_rad = angle_rad + (np.zeros(COUNT) if before is None else before)


def test_an_x_between_two_turns_undoes_them(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.alice.create(COUNT)
        turn(bench, 0.6)
        await bench.alice.apply(block(0, 0), b"\1" * COUNT)
        turn(bench, 0.6)
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert shares(found) == [0, COUNT, 0, 0]
        assert not found.exact

    run(tmp_path, act, {})


def test_a_turn_comes_before_the_gates_that_come_later(tmp_path: Path) -> None:
    """Z before H is X after it: Phi+ becomes Psi+, which H on both halves leaves so."""

    async def act(bench: Bench) -> None:
        await bench.alice.create(COUNT)
        turn(bench, 0.6)
        for half in (0, 1):
            request = ApplyRequest(block=block(0, half), gates=[Gate(name=Gate.H)])
            await bench.alice.act(request)
        found = await bench.alice.bell_measure(block(0, 0), block(0, 1))
        assert within(shares(found)[1], COUNT, np.sin(0.3) ** 2)
        assert shares(found)[0] + shares(found)[1] == COUNT

    run(tmp_path, act, {})


@pytest.mark.parametrize(
    ("basis", "flipped"), [(MeasureRequest.Z, 0.0), (MeasureRequest.X, np.sin(0.3) ** 2)]
)
def test_a_turn_shows_in_measurements_of_x_alone(
    tmp_path: Path, basis: MeasureRequest.Basis, flipped: float
) -> None:
    async def act(bench: Bench) -> None:
        await bench.alice.create(COUNT)
        turn(bench, 0.6)
        one, other = [await bench.alice.measure(block(0, half), basis) for half in (0, 1)]
        bits = (np.frombuffer(found.outcomes, np.uint8) for found in (one, other))
        assert within(int((next(bits) != next(bits)).sum()), COUNT, flipped)
        assert one.exact == (flipped == 0)

    run(tmp_path, act, {})


def test_pairs_are_not_emitted_faster_than_their_source_can(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.charlie.create(10)
        with pytest.raises(grpc.aio.AioRpcError, match=r"rate_hz 2000000 .* 1e\+06") as refused:
            await bench.charlie.send((block(0, 0), "charlie-q0"), rate_hz=2_000_000)
        assert refused.value.code() == grpc.StatusCode.INVALID_ARGUMENT
        await bench.charlie.send((block(0, 0), "charlie-q0"), rate_hz=1_000_000)

    run(tmp_path, act, {"charlie": Device(PairSource(max_rate_hz=1e6))})


def test_light_from_elsewhere_is_sent_on_at_any_rate(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.alice.create(10)
        await bench.alice.send((block(0, 0), "alice-q9"), rate_hz=1_000_000)
        await bench.bob.receive(block(0, 0), "bob-q9")
        await bench.bob.send((block(0, 0), "bob-q9"), rate_hz=2_000_000)

    run(tmp_path, act, {"alice": Device(PairSource(max_rate_hz=1e6))})


def test_a_dispatcher_refuses_what_no_device_is_like(tmp_path: Path) -> None:
    for devices, message in (
        ({"bob": Device(detectors=Detectors(efficiency=2.0))}, "bob, detectors: efficiency 2.0"),
        ({"bab": Device()}, "devices of bab: there are no such hosts"),
    ):
        with pytest.raises((BadParameter, BadConfig), match=message):
            build_layer(configuration(tmp_path, devices=devices), JumpingClock(), None)


def test_a_dispatcher_that_remembers_no_fibre_refuses_compensators(tmp_path: Path) -> None:
    devices = {"bob": Device(compensator=Compensator(retarders=3))}
    config = replace(configuration(tmp_path, devices=devices), history_depth=0)
    with pytest.raises(BadConfig, match="give history_depth 1 or more"):
        build_layer(config, JumpingClock(), None)
