"""Distributed pairs in sessions: used by number, and let go of, whatever happens."""

import asyncio
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from dispatcher_status import held, require_nothing_left
from limits import SOON_S
from stacks_scene import OWN_ADDRESS, Cut, arbitrated, network, refusal

from hosts import network_loop
from hosts.middleware.services.distribution import protocol
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import Lifetimes, expect, values
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.metadata.blocks import Finish
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason, Service
from wire.parameters.physics import Device, Memory, PairSource

LASTING = Lifetimes(*[float("inf")] * 4).numbers()
PAGE = Path(__file__).resolve().parents[3] / "docs" / "distribution.md"


def inside(folder: Path, scene: Callable[[], None], **physics: Any) -> None:
    """Let a scene of applications happen in a network, after which no photon is left."""

    async def run() -> None:
        async with network(folder, **physics):
            await asyncio.to_thread(scene)
            await asyncio.to_thread(require_nothing_left, folder)

    network_loop.run(run())


@contextmanager
def two_sockets(folder: Path) -> Iterator[tuple[ServiceSocket, "Future[ServiceSocket]"]]:
    """Give alice's socket, and bob's when somebody asks."""
    with (
        ThreadPoolExecutor(1) as pool,
        ServiceSocket(folder / "bob.sock") as listener,
        ServiceSocket(folder / "alice.sock") as alice,
    ):
        for one in (listener, alice):
            one.settimeout(SOON_S)
        listener.listen(9, "distribute")
        bob = pool.submit(lambda: listener.accept()[0])
        yield alice, bob


@contextmanager
def delivered(folder: Path, **options: Any) -> Iterator[tuple[ServiceSocket, ServiceSocket]]:
    """Have pairs delivered; give the sockets of both ends."""
    with two_sockets(folder) as (alice, accepting):
        list(alice.request("distribute", ("bob", 9), **options))
        with accepting.result(SOON_S) as bob:
            list(bob.results())
            yield alice, bob


def failed(folder: Path, **options: Any) -> list[QuantumSocketError]:
    """Ask in vain; return the results of alice and bob."""
    with two_sockets(folder) as (alice, accepting):
        with pytest.raises(QuantumSocketError) as at_alice:
            list(alice.request("distribute", ("bob", 9), **options))
        with accepting.result(SOON_S) as bob, pytest.raises(QuantumSocketError) as at_bob:
            list(bob.results())
    return [at_alice.value, at_bob.value]


def measured(end: ServiceSocket, numbers: list[int], basis: str) -> list[int | None]:
    """Return what an end measures."""
    outcomes: list[int | None] = end.ask(measure=numbers, basis=basis)["outcomes"]
    return outcomes


def test_a_number_means_the_same_pair_at_both_ends(tmp_path: Path) -> None:
    def scene() -> None:
        with delivered(tmp_path, count=900, block_pairs=400) as (alice, bob):
            assert alice.summary["session"] == bob.summary["session"]
            for third, basis in enumerate("ZXY"):
                numbers = list(range(third, 900, 3))[::-1]
                ours, theirs = (measured(end, numbers, basis) for end in (alice, bob))
                assert {0, 1} == set(ours)
                flipped = 1 if basis == "Y" else 0  # of Phi+ the outcomes in Y differ
                assert theirs == [outcome ^ flipped for outcome in ours if outcome is not None]

    inside(tmp_path, scene)


def test_purified_pairs_have_the_same_numbers_at_both_ends(tmp_path: Path) -> None:
    def scene() -> None:
        options = {"count": 1000, "rounds": 2, "purification": "bbpssw", "block_pairs": 4096}
        with delivered(tmp_path, **options) as (alice, bob):
            numbers = list(range(1000))
            ours, theirs = (measured(end, numbers, "X") for end in (alice, bob))
            agreed = sum(one == other for one, other in zip(ours, theirs, strict=True))
            assert 900 < agreed < 1000

    inside(tmp_path, scene, devices={"charlie": Device(source=PairSource(fidelity=0.85))})


def test_the_examples_of_the_page_get_the_same_outcomes(tmp_path: Path) -> None:
    """The code is as it stands there; alice waits only until bob listens, or has measured."""
    at_alice, at_bob = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    texts: dict[str, list[Any]] = {"alice": [], "bob": []}
    events = {"listening": Event(), "measured": Event()}

    def perform(host: str, code: str) -> None:
        code = code.replace("ServiceSocket()", f"ServiceSocket({str(tmp_path / host)!r} '.sock')")
        names = {**events, "print": lambda *words: texts[host].append(words[-1])}
        exec(code, names)

    def scene() -> None:
        with ThreadPoolExecutor(1) as pool:
            bob = at_bob.replace('"distribute")', '"distribute"); listening.set()')
            bob = bob.replace("        list(", "        measured.set(); list(")
            asked = pool.submit(perform, "bob", bob)
            assert events["listening"].wait(SOON_S)
            perform("alice", at_alice.replace("asking.shut", "measured.wait(30); asking.shut"))
            asked.result(SOON_S)
        assert texts["alice"][-1] == texts["bob"][-1]
        assert len(texts["bob"][-1]) == 4

    inside(tmp_path, scene)


def test_only_what_is_delivered_is_held_and_nothing_that_was_sacrificed(tmp_path: Path) -> None:
    def scene() -> None:
        with delivered(tmp_path, count=1000, sample=0.5) as (alice, _bob):
            assert alice.summary["sampled"] >= 900
            for node in ("alice", "bob"):
                (block,) = held(tmp_path, node)
                assert (block.photons, block.stored) == (1000, True)

    inside(tmp_path, scene)


QUESTIONS: list[tuple[dict[str, Any], str]] = [
    ({"measure": [3], "basis": "Z"}, "pair 3 is used up"),
    ({"measure": [5, 5], "basis": "Z"}, "named twice"),
    ({"measure": [100], "basis": "Z"}, "pair 100: choose 0 to 99"),
    ({"measure": [-1], "basis": "Z"}, "pair -1: choose 0 to 99"),
    ({"measure": [True], "basis": "Z"}, "pair True: choose 0 to 99"),
    ({"measure": [], "basis": "Z"}, "name 1 to 100000 pairs"),
    ({"measure": "all", "basis": "Z"}, "name 1 to 100000 pairs"),
    ({"measure": [5], "basis": "W"}, "basis 'W': choose X, Y or Z"),
    ({"measure": [5], "basis": ["Z"]}, "basis ['Z']: choose X, Y or Z"),
    ({"steal": [5]}, "name pairs to measure, and a basis"),
]


def test_a_refused_question_changes_nothing(tmp_path: Path) -> None:
    def scene() -> None:
        with delivered(tmp_path, count=100) as (alice, bob):
            before = measured(alice, [3], "Z")
            for question, text in QUESTIONS:
                with pytest.raises(QuantumSocketError, match=re.escape(text)):
                    alice.ask(**question)
            assert measured(bob, [3], "Z") == before
            assert measured(alice, [5], "Z") == measured(bob, [5], "Z")

    inside(tmp_path, scene)


def test_pairs_last_until_the_one_who_asked_ends_it_and_both_are_told(tmp_path: Path) -> None:
    def scene() -> None:
        with delivered(tmp_path, count=100) as (alice, bob):
            assert not alice.over
            alice.shutdown()
            assert alice.over
            list(bob.results())
            assert bob.over
            assert bob.summary["pairs"] == 100
            require_nothing_left(tmp_path)
            for end in (alice, bob):
                with pytest.raises(QuantumSocketError, match="session is over"):
                    measured(end, [1], "Z")

    inside(tmp_path, scene)


def test_the_session_goes_on_without_the_application_that_was_asked(tmp_path: Path) -> None:
    def scene() -> None:
        with delivered(tmp_path, count=100) as (alice, bob):
            bob.close()
            assert len(measured(alice, [1, 2, 3], "Z")) == 3
            alice.shutdown()

    inside(tmp_path, scene)


def test_an_application_that_just_closes_ends_the_session(tmp_path: Path) -> None:
    def scene() -> None:
        with delivered(tmp_path, count=100) as (alice, bob):
            alice.close()
            list(bob.results())
            assert bob.over

    inside(tmp_path, scene)


@pytest.mark.parametrize("node", ["alice", "bob"])
def test_a_full_memory_is_told_and_everything_freed(tmp_path: Path, node: str) -> None:
    def scene() -> None:
        at_alice, at_bob = failed(tmp_path, count=1000)
        for error in (at_alice, at_bob):
            assert f"exceed the capacity of {node}'s memory, 500" in str(error)
            assert error.reason == Reason.HARDWARE

    inside(tmp_path, scene, devices={node: Device(memory=Memory(capacity=500))}, report=False)


@pytest.mark.parametrize(
    ("fidelity", "options", "words"),
    [
        (0.8, {"purification": "none"}, "0 rounds of purification: allow purification (bbpssw"),
        (0.8, {"rounds": 1}, "1 rounds of purification: allow more rounds (at most 8)"),
        (0.3, {}, "0 rounds of purification: pairs of 0.5 or less cannot be purified"),
    ],
)
def test_a_fidelity_that_cannot_be_reached_is_told_and_everything_freed(
    tmp_path: Path, fidelity: float, options: dict[str, Any], words: str
) -> None:
    def scene() -> None:
        at_alice, at_bob = failed(tmp_path, count=1000, fidelity=0.97, **options)
        for error in (at_alice, at_bob):
            assert "fidelity 0.97 is wanted, 0." in str(error)
            assert words in str(error)
            assert error.reason == Reason.TOO_NOISY

    inside(tmp_path, scene, devices={"charlie": Device(source=PairSource(fidelity=fidelity))})


def test_without_light_at_one_end_there_are_no_pairs(tmp_path: Path) -> None:
    def scene() -> None:
        at_alice, _at_bob = failed(tmp_path, count=10)
        assert "no pair of the last 10 blocks of light has arrived at both ends" in str(at_alice)
        assert at_alice.reason == Reason.NO_LIGHT

    inside(tmp_path, scene, paths=[(4, 1)])


@pytest.mark.parametrize(("rounds", "reason"), [(3, Reason.TOO_NOISY), (0, Reason.NO_LIGHT)])
def test_light_is_not_asked_for_without_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rounds: int, reason: Reason
) -> None:
    monkeypatch.setattr(protocol, "MOST_EMITTED", 100)
    monkeypatch.setattr(protocol, "MOST_EMITTED_EACH", 1)

    def scene() -> None:
        for error in failed(tmp_path, count=1000, rounds=rounds, block_pairs=200):
            assert "of 1000 pairs after 1200 were made, of which" in str(error)
            assert f"and {rounds} rounds of purification" in str(error)
            assert error.reason == reason

    inside(tmp_path, scene, loss_db_per_km=100.0)


def test_an_application_that_was_asked_and_goes_in_mid_protocol_ends_it(tmp_path: Path) -> None:
    def scene() -> None:
        with two_sockets(tmp_path) as (alice, accepting):
            results = alice.request("distribute", ("bob", 9), count=100_000, block_pairs=200)
            next(results)
            accepting.result(SOON_S).close()
            with pytest.raises(QuantumSocketError, match="receiving application has ended"):
                list(results)

    inside(tmp_path, scene)


def test_an_opener_that_goes_in_mid_protocol_leaves_nothing_behind(tmp_path: Path) -> None:
    def scene() -> None:
        with two_sockets(tmp_path) as (alice, accepting):
            next(alice.request("distribute", ("bob", 9), count=100_000, block_pairs=200))
            alice.close()
            with accepting.result(SOON_S) as bob, pytest.raises(QuantumSocketError):
                list(bob.results())

    inside(tmp_path, scene)


@pytest.mark.parametrize("count", [100, 100_000])
def test_a_cut_connection_ends_the_session_at_both_ends(tmp_path: Path, count: int) -> None:
    """After 100 pairs are delivered, or before 100,000 are."""
    cuts: Future[Cut] = Future()

    def scene() -> None:
        with two_sockets(tmp_path) as (alice, accepting):
            results = alice.request("distribute", ("bob", 9), count=count, block_pairs=200)
            next(results)
            with accepting.result(SOON_S) as bob:
                if count == 100:
                    for left in (results, bob.results()):
                        list(left)
                cuts.result()()
                for end in (alice, bob):
                    with pytest.raises(QuantumSocketError):
                        list(end.results())

    inside(tmp_path, scene, cuts=cuts)


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([values(5, Topic.PURIFY, 1, [1, 7], 32)], "there are no pairs of block 1"),
        ([values(5, Topic.SAMPLE, 1, [1, 1], 1)], "there are no pairs of block 1"),
        ([values(5, Topic.DELIVER, 0, [7, *LASTING], 32)], "7 of 0 pairs to deliver"),
        ([values(5, Topic.DELIVER, 0, [2_000_000, *LASTING], 32)], "2000000 of 0 pairs"),
        ([values(5, Topic.COMING, 1, [20_000], 32)], "a value of topic 1 is 20000"),
        ([values(5, 99, 0, [1], 32)], "values of topic 99"),
        ([Finish(5, 0, bytes(32))], "ended before pairs were delivered"),
    ],
)
def test_an_opener_that_breaks_the_protocol_is_refused(
    tmp_path: Path, messages: list[Message], words: str
) -> None:
    async def run() -> None:
        async with network(tmp_path):
            with ServiceSocket(tmp_path / "bob.sock") as listener:
                await asyncio.to_thread(listener.listen, 9, "distribute")
                accepting = asyncio.create_task(asyncio.to_thread(listener.accept))
                channel = await MetadataChannel.connect("bob", OWN_ADDRESS["bob"])
                setup = Setup(5, Service.DISTRIBUTE, 1, "10.0.0.9", 16_384, 1, 1_000_000, port=9)
                await channel.request(arbitrated(setup, "bob", channel))
                report = await channel.receive(Values, SOON_S)
                assert expect(report, Topic.NODE_FEATURES, 0, 7, 1 << 32).tolist()[0] == setup.pairs
                for message in messages:
                    channel.send(message)
                with pytest.raises(SessionError, match=words):
                    await channel.receive(Values, SOON_S)
                channel.close()
                with (await accepting)[0] as bob, pytest.raises(QuantumSocketError, match=words):
                    await asyncio.to_thread(list, bob.results())
            await asyncio.to_thread(require_nothing_left, tmp_path)

    network_loop.run(run())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 2_000_000}, "count 2000000: choose 1 to 1000000"),
        ({"fidelity": 1.5}, "fidelity 1.5: choose 0 to 1"),
        ({"fidelity": "high"}, "fidelity 'high': choose 0 to 1"),
        ({"fidelity": True}, "fidelity True: choose 0 to 1"),
        ({"fidelity": float("nan")}, "fidelity nan: choose 0 to 1"),
        ({"sample": 0.95}, "sample 0.95: choose 0 to 0.9"),
        ({"sample": 0, "fidelity": 0.9}, "fidelity 0.9 cannot be known with sample 0"),
        ({"purification": "magic"}, "purification 'magic': choose one of none, bbpssw, dejmps"),
        ({"rounds": 9}, "rounds 9: choose 0 to 8"),
        ({"rounds": 1, "purification": "none"}, "choose bbpssw or dejmps"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    assert words in refusal(tmp_path, "distribute", **options)
