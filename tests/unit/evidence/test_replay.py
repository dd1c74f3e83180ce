"""A run that is replayed gives the same events, byte for byte; a spoiled record is refused."""

import asyncio
import io
import random
import stat
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import grpc
import pytest
import uvloop
from dispatcher_network import (
    START_NS,
    Bench,
    Client,
    JumpingClock,
    block,
    configuration,
    running,
    with_fibers,
)
from limits import SOON_S, until

from dispatcher.build import open_layer
from dispatcher.clock import Clock, NetworkClock
from dispatcher.server.server import build_service
from evidence.replay.replay import replay
from wire import dispatcher_record
from wire.dispatcher_pb2 import (
    AdjustFiberRequest,
    AdjustMemoryRequest,
    ApplyRequest,
    Connection,
    CreateRequest,
    DiscardRequest,
    Gate,
    GatherRequest,
    Launch,
    MeasureRequest,
    Order,
    Pick,
    ReceiveRequest,
    ResendRequest,
    SendRequest,
    SplitRequest,
    Step,
    StoreRequest,
)
from wire.dispatcher_record import BadRecord
from wire.parameters.physics import BellAnalyser, Detectors, Device, Memory, PairSource
from wire.positions import pack
from wire.record_pb2 import Clock as ClockEntry
from wire.record_pb2 import Entry, Header, Request, Resumed

Act = Callable[[Bench], Awaitable[None]]


def recorded(folder: Path, clock: Clock, act: Act, **changes: Any) -> tuple[bytes, str]:
    """Let something happen in a noisy network; return the record and the event log."""
    file, log = folder / "dispatcher.record", folder / "quantum.log"
    config = configuration(folder, event_log=str(log), record=str(file))
    config = with_fibers(config, loss_db_per_km=5.0, depolarizing=0.4, length_km=0.3)
    config = replace(config, **changes)

    async def run() -> None:
        async with running(config, clock) as bench:
            await act(bench)

    uvloop.run(run())
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    content = file.read_bytes()
    assert b"token of" not in content
    return content, log.read_text()


def replayed(content: bytes, allow_code: bool = False) -> str:
    """Replay a record; return its event log."""
    log = io.StringIO()
    replay(io.BytesIO(content), log, allow_code=allow_code)
    return log.getvalue()


async def superdense(bench: Bench) -> None:
    """Send a message by superdense coding."""
    await bench.switch.connect((3, 4))
    await bench.alice.create(200)
    await bench.alice.apply(block(0, 1), bytes(n % 4 for n in range(200)))
    await bench.alice.send((block(0, 0), "alice-q9"), (block(0, 1), "alice-q0"))
    await bench.bob.receive(block(0, 0), "bob-q9")
    await bench.bob.receive(block(0, 1), "bob-q0")
    await bench.bob.bell_measure(block(0, 0), block(0, 1))


@pytest.mark.parametrize("clock", [JumpingClock, NetworkClock])
@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_a_transmission_is_replayed_byte_for_byte(
    tmp_path: Path, clock: Callable[[], Clock], backend: str
) -> None:
    content, log = recorded(tmp_path, clock(), superdense, backend=backend)
    assert log.count("\n") >= 10
    assert replayed(content) == log


async def prepared(bench: Bench) -> None:
    """Send photons in the six cardinal states."""
    states = bytes(n % 6 for n in range(200))
    request = CreateRequest(session=7, count=200, state=CreateRequest.PREPARED, states=states)
    await bench.alice.act(request)
    await bench.alice.send((block(), "alice-q9"))
    await bench.bob.receive(block(), "bob-q9")
    await bench.bob.act(MeasureRequest(block=block(), bases=bytes(n % 3 for n in range(200))))


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_prepared_photons_are_replayed_byte_for_byte(tmp_path: Path, backend: str) -> None:
    content, log = recorded(tmp_path, JumpingClock(), prepared, backend=backend)
    assert "prepared: |0>=34 |1>=34" in log
    assert replayed(content) == log


async def gathered(bench: Bench) -> None:
    """Gather photons at both ends of a fibre, stored ones and others, and compare them."""
    await bench.alice.create(200)
    await bench.alice.send((block(0, 1), "alice-q9"))
    await bench.bob.receive(block(0, 1), "bob-q9")
    odd, even = list(range(1, 200, 2)), list(range(0, 200, 2))
    for client, half in ((bench.alice, 0), (bench.bob, 1)):
        await client.act(StoreRequest(block=block(0, half)))
        for number, photons, keep in ((1, odd, True), (2, even, False)):
            pick = Pick(block=block(0, half), photons=pack(photons))
            request = GatherRequest(into=block(number, half), picks=[pick], keep_rest=keep)
            await client.act(request)
        gate = Gate(name=Gate.CX, target=block(2, half))
        await client.act(ApplyRequest(block=block(1, half), gates=[gate]))
        await client.measure(block(2, half))
    with pytest.raises(grpc.aio.AioRpcError):
        await bench.bob.act(GatherRequest(into=block(3)))
    await bench.alice.discard(DiscardRequest(session=7))
    await bench.bob.measure(block(1, 1))


@pytest.mark.parametrize("clock", [JumpingClock, NetworkClock])
@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_gathered_photons_are_replayed_byte_for_byte(
    tmp_path: Path, clock: Callable[[], Clock], backend: str
) -> None:
    device = Device(memory=Memory(t1_s=0.05, t2_s=0.05, efficiency=0.9))
    devices = {"alice": device, "bob": device}
    content, log = recorded(tmp_path, clock(), gathered, backend=backend, devices=devices)
    assert "100 of 200 of 0/0, still stored" in log
    assert replayed(content) == log


async def resent(bench: Bench) -> None:
    """Measure and resend some photons between alice and bob, one way with dark counts."""
    await bench.alice.create(200)
    await bench.alice.send((block(0, 1), "alice-q9"))
    await bench.bob.receive(block(0, 1), "bob-q9")
    await bench.bob.act(StoreRequest(block=block(0, 1)))
    for shift in (0, 1):
        bases = bytes((0, 1, 255, 2)[(n + shift) % 4] for n in range(200))
        await bench.bob.act(ResendRequest(block=block(0, 1), bases=bases))
    with pytest.raises(grpc.aio.AioRpcError):
        await bench.bob.act(ResendRequest(block=block(0, 1)))
    await bench.bob.measure(block(0, 1), MeasureRequest.X)
    await bench.alice.measure(block(0, 0), MeasureRequest.X)


@pytest.mark.parametrize("backend", ["chp", "stim", "dense"])
def test_resent_photons_are_replayed_byte_for_byte(tmp_path: Path, backend: str) -> None:
    devices = {"bob": Device(detectors=Detectors(0.9, 1e7, 1e-9))}
    content, log = recorded(tmp_path, JumpingClock(), resent, backend=backend, devices=devices)
    assert log.count(" resend ") == 2
    assert replayed(content) == log


async def divided(bench: Bench) -> None:
    """Split photons off pulses on their way, and measure all of them."""
    states = bytes(n % 4 for n in range(500))
    request = CreateRequest(session=7, number=0, count=500, state=CreateRequest.PREPARED)
    request.states = states
    await bench.alice.act(request)
    await bench.alice.send((block(0, 0), "alice-q9"))
    await bench.bob.receive(block(0, 0), "bob-q9")
    await bench.bob.act(SplitRequest(block=block(0), into=block(7)))
    await bench.bob.measure(block(7, 0), MeasureRequest.X)
    await bench.bob.measure(block(0, 0), MeasureRequest.X)


def test_split_pulses_are_replayed_byte_for_byte(tmp_path: Path) -> None:
    devices = {"alice": Device(PairSource("poisson", 0.9))}
    content, log = recorded(tmp_path, JumpingClock(), divided, devices=devices)
    assert log.count(" split ") == 1
    assert replayed(content) == log


class Crowd:
    """Hosts that ask for many things at once, in no order that anybody planned."""

    def __init__(self, bench: Bench, seed: int) -> None:
        """Use this network."""
        self.bench, self.random = bench, random.Random(seed)

    async def run(self) -> None:
        """Let everyone do something at the same time."""
        async with asyncio.timeout(SOON_S), asyncio.TaskGroup() as group:
            for number in range(12):
                group.create_task(self.transmit(number))
                group.create_task(self.receive(number))
            group.create_task(self.switch())
            group.create_task(self.orders())
            group.create_task(self.look())

    async def transmit(self, number: int) -> None:
        """Make a block and send both halves, one through the switch."""
        alice, count = self.bench.alice, self.random.randint(1, 60)
        await alice.create(count, number=number)
        await alice.apply(block(number, 1), bytes(self.random.randrange(4) for _ in range(count)))
        await alice.send(
            (block(number, 0), "alice-q9"),
            (block(number, 1), "alice-q0"),
            rate_hz=self.random.choice([10_000, 1_000_000]),
        )

    async def receive(self, number: int) -> None:
        """Wait for a block, not always long enough; some go away while they wait."""
        bob = self.bench.bob
        patience_s = self.random.choice([0.002, 1.0])
        try:
            await bob.receive(block(number, 0), "bob-q9", timeout_s=patience_s)
            await bob.measure(block(number, 0), MeasureRequest.X)
            await asyncio.wait_for(bob.receive(block(number, 1), "bob-q0"), 0.02)
            await bob.measure(block(number, 1))
        except (grpc.RpcError, TimeoutError):
            await bob.discard(DiscardRequest(session=7))

    async def switch(self) -> None:
        """Change cross-connects while light is on its way."""
        for _ in range(20):
            ways = self.random.choice([[(3, 4)], [(3, 5)], [(3, 4), (1, 5)], []])
            await self.bench.switch.connect(*ways)
            await self.bench.switch.tune(4, power_dbm=-self.random.random())
            await asyncio.sleep(self.random.random() / 300)
        stuck = Connection(in_port=3, out_port=4)
        await self.bench.runner.inject(stuck=stuck)
        await self.bench.runner.inject(repair=True)

    async def orders(self) -> None:
        """Let charlie perform orders side by side, one of which fails."""

        async def given() -> Any:
            for number in range(1, 9):
                create = CreateRequest(session=9, number=number // 2, count=20)
                name = block(number // 2, 0, session=9)
                launch = Launch(block=name, port="charlie-q0")
                yield Order(
                    number=number,
                    steps=[
                        Step(create=create),
                        Step(apply=ApplyRequest(block=name, paulis=bytes(20))),
                        Step(send=SendRequest(launches=[launch], rate_hz=50_000)),
                        Step(receive=ReceiveRequest(block=name, port="charlie-q0", timeout_s=0.01)),
                    ],
                )

        charlie: Client = self.bench.charlie
        async for _outcome in charlie.stub.Perform(
            given(), metadata=charlie.metadata, timeout=SOON_S
        ):
            pass

    async def look(self) -> None:
        """Ask what changes nothing, but reads the clock."""
        for _ in range(20):
            await self.bench.switch.statistics()
            await self.bench.runner.status()
            await asyncio.sleep(0.001)


@pytest.mark.parametrize("seed", range(4))
def test_what_happens_at_the_same_time_is_replayed_in_its_order(tmp_path: Path, seed: int) -> None:
    async def act(bench: Bench) -> None:
        await Crowd(bench, seed).run()

    content, log = recorded(tmp_path, NetworkClock(), act)
    assert log.count("\n") > 100
    assert replayed(content) == log


DAMPING = str(Path(__file__).parents[3] / "docs" / "noise-models" / "damping.py") + ":Damping"
EVERYTHING: dict[str, Any] = {
    "dephasing": 0.1,
    "phase_drift_rad_per_sqrt_km": 1.0,
    "phase_drift_time_s": 1e-3,
    "burst_depolarizing": 0.9,
    "burst_start_hz": 1e4,
    "burst_end_hz": 1e4,
    "temperature_walk_k_per_sqrt_s": 5.0,
    "classical_mw": 1.0,
    "raman_per_km_nm": 1e-4,
}
DEVICE = Device(
    source=PairSource(statistics="thermal", mean_pairs=0.5, fidelity=0.9, jitter_ps=300.0),
    memory=Memory(t1_s=0.1, t2_s=0.15, efficiency=0.9),
    detectors=Detectors(0.7, dark_count_hz=1e6, dead_time_s=1e-7, afterpulse_probability=0.3),
    analyser=BellAnalyser(visibility=0.8),
)


@pytest.mark.parametrize(
    ("damping", "kraus"), [("twirl", False), ("dense", False), ("dense", True)]
)
def test_every_noise_that_there_is_is_replayed(tmp_path: Path, damping: str, kraus: bool) -> None:
    async def act(bench: Bench) -> None:
        for number in range(3):
            await bench.alice.create(100, number=number)
            for half in (0, 1):
                await bench.alice.act(StoreRequest(block=block(number, half)))
            await bench.alice.send((block(number, 0), "alice-q9"), rate_hz=10_000)
            adjust = AdjustFiberRequest(a="alice", b="bob", classical_mw=float(number))
            await bench.runner.call("AdjustFiber", adjust)
            await bench.runner.call(
                "AdjustFiber", AdjustFiberRequest(a="alice", b="bob", calibrate=True)
            )
            await bench.alice.send((block(number, 1), "alice-q9"), rate_hz=10_000)
            memory = AdjustMemoryRequest(node="bob", settings={"t2_s": 0.15 / (1 + number)})
            await bench.runner.call("AdjustMemory", memory)
            for half in (0, 1):
                await bench.bob.receive(block(number, half), "bob-q9")
            await bench.bob.bell_measure(block(number, 0), block(number, 1))

    device = replace(DEVICE, memory=replace(DEVICE.memory, damping=damping))
    everything, changes = EVERYTHING, dict[str, Any]()
    if kraus:
        everything = EVERYTHING | {"noise": DAMPING, "noise_parameters": {"gamma": 0.2}}
        changes["backend"] = "dense"
    fibers = with_fibers(configuration(tmp_path), length_km=0.3, **everything).fibers
    changes |= {"fibers": fibers, "devices": {"alice": device, "bob": device}}
    content, log = recorded(tmp_path, NetworkClock(), act, **changes)
    for word in ("calibrate", "memory: t2_s 0.05", "dark", "in pulses", "after 0.0"):
        assert word in log
    assert replayed(content, allow_code=kraus) == log


class TogetherClock:
    """A clock on which all waits end at once."""

    def __init__(self) -> None:
        """Begin before the end of all waits."""
        self.over = asyncio.Event()

    def now_ns(self) -> int:
        """Return the time."""
        return START_NS

    async def wait_until(self, _time_ns: int) -> None:
        """Wait for the end of all waits."""
        await self.over.wait()


def test_waits_that_end_together_are_replayed_in_their_order(tmp_path: Path) -> None:
    clock, file, log = TogetherClock(), tmp_path / "record", io.StringIO()
    config = configuration(tmp_path, record=str(file))

    async def run() -> None:
        with ExitStack() as stack:
            layer = open_layer(config, clock, log, stack)
            service = build_service(config, layer, lambda error: None)
            tasks = []
            for number in range(2):
                name = block(number)
                create = CreateRequest(session=7, number=number, count=1)
                send = SendRequest(launches=[Launch(block=name, port="alice-q9")], rate_hz=1)
                receive = ReceiveRequest(block=name, port="bob-q9", timeout_s=5)
                await service.change("alice", "create", create)
                tasks += [
                    asyncio.create_task(service.change(node, kind, request))
                    for node, kind, request in (
                        ("bob", "receive", receive),
                        ("alice", "send", send),
                    )
                ]
            await asyncio.sleep(0.01)
            clock.over.set()
            await asyncio.gather(*tasks)

    uvloop.run(run())
    kinds = [line.split()[2] for line in log.getvalue().splitlines()]
    assert kinds[-4:] == ["arrive", "arrive", "receive", "receive"]
    assert replayed(file.read_bytes()) == log.getvalue()


def test_a_run_that_ends_while_light_is_on_its_way_is_replayed(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.alice.create(10)
        sending = asyncio.ensure_future(bench.alice.send((block(), "alice-q9"), rate_hz=1))
        await until(lambda: bench.layer.history.count >= 2)  # created, and sent
        sending.cancel()

    content, log = recorded(tmp_path, NetworkClock(), act)
    assert log.count("\n") == 2
    assert replayed(content) == log


def test_another_seed_gives_another_log(tmp_path: Path) -> None:
    content, log = recorded(tmp_path, JumpingClock(), superdense)
    assert replayed(content.replace(b'"seed": 1,', b'"seed": 2,')) != log


def test_a_record_is_never_written_over(tmp_path: Path) -> None:
    recorded(tmp_path, JumpingClock(), superdense)
    with pytest.raises(FileExistsError):
        recorded(tmp_path, JumpingClock(), superdense)


def entries(*parts: Entry) -> bytes:
    """Return a record of these entries."""
    file = io.BytesIO()
    dispatcher_record.begin(file)
    for part in parts:
        dispatcher_record.write(file, part)
    return file.getvalue()


def header(folder: Path) -> Entry:
    """Return the header of a small network's record."""
    content, _log = recorded(folder, JumpingClock(), superdense)
    return next(dispatcher_record.read(io.BytesIO(content)))


def test_every_cut_of_a_record_is_refused_or_shorter(tmp_path: Path) -> None:
    content, log = recorded(tmp_path, JumpingClock(), superdense)
    whole = 0
    for length in range(0, len(content), 7):
        try:
            assert log.startswith(replayed(content[:length]))
            whole += 1
        except BadRecord:
            continue
    assert whole < len(content) / 7 / 5


def places(content: bytes) -> list[int]:
    """Return where the entries of a record begin; the first is the header."""
    found = [len(dispatcher_record.MAGIC)]
    while found[-1] < len(content):
        (length,) = dispatcher_record.LENGTH.unpack_from(content, found[-1])
        found.append(found[-1] + dispatcher_record.LENGTH.size + length)
    return found[:-1]


def told_before(content: bytes) -> dict[int, str]:
    """Return the events that the entries before a place tell, where a record can end there."""
    events = {}
    for place in places(content)[1:]:
        with suppress(BadRecord):
            events[place] = replayed(content[:place])
    return events


@pytest.mark.nightly
def test_spoiled_bytes_are_refused_or_change_nothing_that_was_before(tmp_path: Path) -> None:
    content, log = recorded(tmp_path, JumpingClock(), superdense)
    before = told_before(content)
    assert len(set(before.values())) > 5
    draws, outcomes = random.Random(1), Counter[str]()
    for _ in range(300):
        place = draws.randrange(min(before), len(content))
        spoiled = bytearray(content)
        spoiled[place] ^= 1 << draws.randrange(8)
        try:
            events = replayed(bytes(spoiled))
        except BadRecord:
            outcomes["refused"] += 1
            continue
        untouched = before[max(each for each in before if each <= place)]
        assert events.startswith(untouched)
        assert events == replayed(bytes(spoiled))
        outcomes["other" if events != log else "alike"] += 1  # as of a longer time-out
    assert outcomes["refused"] > outcomes["other"] > outcomes["alike"] > 0


def test_another_operator_that_was_asked_for_gives_other_events(tmp_path: Path) -> None:
    """Each of the 200 photons has one of four operators; a fifth is refused to all."""
    content, log = recorded(tmp_path, JumpingClock(), superdense)
    asked = bytes(n % 4 for n in range(200))
    first = content.index(asked)
    for place in range(first, first + len(asked), 19):
        for operator in range(5):
            changed = content[:place] + bytes([operator]) + content[place + 1 :]
            assert (replayed(changed) == log) == (changed == content)


def test_what_is_no_record_is_refused_with_the_reason(tmp_path: Path) -> None:
    first = header(tmp_path)
    request = Request(number=1, node="alice", kind="create", message=b"\x18\x01")
    for content, reason in (
        (b"", "does not begin as a record"),
        (b"#!/bin/sh\n" * 10, "does not begin as a record"),
        (entries(), "empty"),
        (entries(Entry(request=request)), "the header comes first"),
        (entries(first, first), "the header comes first"),
        (entries(first, Entry()), "no known kind"),
        (entries(Entry(header=Header(config="{}"))), "configuration is not of this version"),
        (entries(Entry(header=Header(config="["))), "configuration is not of this version"),
        (entries(first) + b"\xff\xff\xff\xff", "claims 4,294,967,295 bytes"),
        (entries(first) + b"\x00\x00\x00\x02\xff\xff", "malformed"),
        (entries(first, Entry(request=request)), "reads the clock more often"),
        (
            entries(first, Entry(resumed=Resumed(request=3, task=1))),
            "task 1 of request 3 does not wait",
        ),
        (
            entries(first, Entry(request=Request(number=1, kind="destroy"))),
            "unknown kind 'destroy'",
        ),
        (
            entries(first, Entry(request=Request(number=1, kind="create", message=b"\xff"))),
            "request 1 is malformed",
        ),
    ):
        with pytest.raises(BadRecord, match=reason):
            replayed(content)
    clock = Entry(clock=ClockEntry(request=1, time_ns=5))
    assert "create" in replayed(entries(first, Entry(request=request), *[clock] * 4))
