"""Key distribution between whole stacks over loopback, with a real dispatcher."""

import asyncio
import re
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import exp, sqrt
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S
from stacks_scene import (
    Change,
    Judge,
    accepted,
    ask,
    grant,
    live_qubits,
    network,
    refusal,
    requested,
)

from applications.key_distribution import light as key_light
from applications.key_distribution import session as key_session
from applications.qkd import keyring
from applications.qkd import messages as qkd
from applications.qkd.key_length import finite_key_length
from hosts import network_loop
from hosts.middleware.session.options import MAX_BLOCK_PAIRS
from hosts.middleware.session.values import values
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.config import PathOptics
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.values import Envelope, Topic, Values
from wire.outcomes import Pauli
from wire.parameters.physics import Detectors, Device, PairSource

PATHS = {"bb84": [(1, 2)], "bbm92": [(4, 1), (5, 2)]}
FIBERS = {"bb84": 2, "bbm92": 4}  # that two correlated outcomes have passed together
COUNT = 40_000

protocols = pytest.mark.parametrize("protocol", list(PATHS))


def keys(folder: Path, host: str, other: str, hand_out: str) -> dict[str, bytes]:
    """Return what is in a host's store by key id; everything there is private."""
    place = folder / "keys" / host / other / hand_out
    assert (place.stat().st_mode & 0o777, place.parent.stat().st_mode & 0o777) == (0o700, 0o700)
    files = list(place.iterdir())
    assert {file.stat().st_mode & 0o777 for file in files} <= {0o600}
    return {file.name: file.read_bytes() for file in files}


def distribute(
    folder: Path, protocol: str, judge: Judge = grant, **words: Any
) -> list[dict[str, Any]]:
    """Run a session; `physics` are words for the fibres, all others are options."""
    physics = {"paths": PATHS[protocol], **words.pop("physics", {})}
    return ask(folder, protocol, judge, physics, **{"count": COUNT, **words})


@dataclass
class Failed:
    """How a session that must fail has ended."""

    alice: str
    bob: str
    reports: list[dict[str, Any]]  # to alice's application
    live_qubits: int


def failure(
    folder: Path,
    protocol: str,
    judge: Judge = grant,
    change: Change | None = None,
    physics: dict[str, Any] | None = None,
    **options: Any,
) -> Failed:
    """Run a session that must fail at both ends, and leave no key at either."""

    def asked() -> Failed:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(folder / "alice.sock") as asking:
            listening: Future[None] = Future()
            bob = pool.submit(accepted, folder, protocol, listening)
            listening.result(SOON_S)
            asking.settimeout(SOON_S)
            reports: list[dict[str, Any]] = []
            with pytest.raises(QuantumSocketError) as caught:
                reports.extend(asking.request(protocol, ("bob", 9), **{"count": COUNT, **options}))
            with pytest.raises(QuantumSocketError) as theirs:
                bob.result(SOON_S)
        return Failed(str(caught.value), str(theirs.value), reports, 0)

    async def run() -> Failed:
        words = {"paths": PATHS[protocol], **(physics or {})}
        async with network(folder, judge, change=change, **words):
            failed = await asyncio.to_thread(asked)
            return replace(failed, live_qubits=await live_qubits(folder))

    failed = network_loop.run(run())
    assert [path for path in (folder / "keys").rglob("*") if path.is_file()] == []
    assert failed.live_qubits == 0
    return failed


@protocols
@pytest.mark.parametrize("correction", ["cascade", "ldpc"])
def test_both_stores_end_with_the_same_keys(tmp_path: Path, protocol: str, correction: str) -> None:
    physics = {"depolarizing": 0.01}
    alice, bob = distribute(tmp_path, protocol, physics=physics, correction=correction)
    for ours, theirs in (("first", "second"), ("second", "first")):
        mine = keys(tmp_path, "alice", "bob", ours)
        assert mine == keys(tmp_path, "bob", "alice", theirs)
        assert abs(len(mine) - alice["keys"] / 2) < 1
        assert len(set(mine.values())) == len(mine)
        assert {len(key) for key in mine.values()} == {256 // 8}
    assert alice["keys"] == alice["key_bits"] // 256 > 0
    assert alice["first_key_id"] in keys(tmp_path, "alice", "bob", "first")
    timed = {name for name in alice if name.endswith("_s")}
    assert {name: alice[name] for name in alice.keys() - timed} == {
        name: bob[name] for name in bob.keys() - timed
    }


@protocols
def test_a_session_makes_keys_one_after_another_as_long_as_bits_are_wanted(
    tmp_path: Path, protocol: str
) -> None:
    """Each is that of the finite-key bound for a third of the bits, and all are in both stores."""
    words: dict[str, Any] = {"physics": {"depolarizing": 0.005}, "block_pairs": 16_384}
    alice, bob = distribute(tmp_path, protocol, count=90_000, sifted_per_key=30_000, **words)
    assert 90_000 <= alice["sifted_bits"] < 90_000 + 2 * 16_384
    one = finite_key_length(27_000, 3_000, alice["qber"], alice["leaked_bits"] // 3, 1e-10, 1e-15)
    assert alice["key_bits"] == pytest.approx(3 * one, rel=0.15)
    assert alice["keys"] == bob["keys"] > 3 * one // 256 * 0.85
    for ours, theirs in (("first", "second"), ("second", "first")):
        mine = keys(tmp_path, "alice", "bob", ours)
        assert mine == keys(tmp_path, "bob", "alice", theirs)
    held = [keys(tmp_path, "alice", "bob", way) for way in ("first", "second")]
    assert sum(map(len, held)) == alice["keys"]
    assert len({key for each in held for key in each.values()}) == alice["keys"]


@protocols
def test_the_error_rate_of_depolarised_light_is_that_of_theory(
    tmp_path: Path, protocol: str
) -> None:
    share = 0.03  # of each fibre: X, Y and Z each with probability share / 4
    physics = {"depolarizing": share}
    alice, bob = distribute(tmp_path, protocol, physics=physics, count=100_000, test_fraction=0.5)
    fidelity = (1 + 3 * (1 - share) ** FIBERS[protocol]) / 4
    qber = 2 * (1 - fidelity) / 3
    for summary in (alice, bob):
        error = sqrt(qber * (1 - qber) / summary["disclosed_bits"])
        assert abs(summary["qber"] - qber) < 5 * error
        assert summary["qber_low"] < summary["qber"] < summary["qber_high"]


@protocols
def test_bits_that_detectors_tell_wrongly_are_errors(tmp_path: Path, protocol: str) -> None:
    """Of BB84 with e; of BBM92 if one end is wrong and the other right, 2 e (1 - e)."""
    share = 0.03
    devices = dict.fromkeys(("alice", "bob"), Device(detectors=Detectors(readout_error=share)))
    words: dict[str, Any] = {"count": 100_000, "test_fraction": 0.5}
    alice, _bob = distribute(tmp_path, protocol, physics={"devices": devices}, **words)
    qber = share if protocol == "bb84" else 2 * share * (1 - share)
    assert abs(alice["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / alice["disclosed_bits"])


@protocols
def test_lost_light_costs_bits_and_makes_no_errors(tmp_path: Path, protocol: str) -> None:
    alice, _bob = distribute(tmp_path, protocol, physics={"loss_db_per_km": 150.0})
    passed = 10 ** (-2 * 1.5 / 10)  # two fibres of 10 m on each way
    photons = alice["photons"]
    assert abs(alice["raw_bits"] / photons - passed) < 5 * sqrt(passed * (1 - passed) / photons)
    both = passed ** (1 if protocol == "bb84" else 2) / 2  # and the bases must agree
    assert abs(alice["sifted_bits"] / photons - both) < 5 * sqrt(both * (1 - both) / photons)
    assert alice["sifted_bits"] >= COUNT
    assert alice["qber"] == 0
    assert alice["key_bits"] > 0


@pytest.mark.parametrize("rotation", [Pauli.X, Pauli.Z, Pauli.XZ])
def test_a_known_rotation_of_the_path_is_undone(tmp_path: Path, rotation: Pauli) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), rotation=rotation)

    alice, _bob = distribute(tmp_path, "bb84", judge, physics={"rotation": rotation})
    assert (alice["qber"], alice["key_bits"] > 0) == (0, True)


@pytest.mark.parametrize("rotation", [Pauli.X, Pauli.Z, Pauli.XZ])
def test_a_known_rotation_of_one_half_of_pairs_is_undone(tmp_path: Path, rotation: Pauli) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), rotation=rotation)

    optics = [PathOptics(*PATHS["bbm92"][1], rotation=rotation)]
    alice, _bob = distribute(tmp_path, "bbm92", judge, physics={"optics": optics})
    assert (alice["qber"], alice["key_bits"] > 0) == (0, True)


@protocols
@pytest.mark.parametrize(("rotation", "wrong"), [(Pauli.X, 0.5), (Pauli.Z, 0.5), (Pauli.XZ, 1)])
def test_a_rotation_that_is_not_undone_turns_the_outcomes_of_one_basis_or_of_both(
    tmp_path: Path, protocol: str, rotation: Pauli, wrong: float
) -> None:
    optics = [PathOptics(*PATHS[protocol][-1], rotation=rotation)]
    failed = failure(tmp_path, protocol, physics={"optics": optics})
    assert failed.reports[-1]["qber"] == pytest.approx(wrong, abs=0.05)


@protocols
def test_above_the_threshold_nothing_is_delivered(tmp_path: Path, protocol: str) -> None:
    failed = failure(tmp_path, protocol, physics={"depolarizing": 0.3})
    for text in (failed.alice, failed.bob):
        assert "no key" in text
        assert "at most 0.1000 is allowed: noise or an eavesdropper" in text
    measured = failed.reports[-1]
    assert f"(QBER {measured['qber']:.4f})" in failed.alice
    assert (measured["keys"], measured["key_bits"]) == (0, 0)
    assert measured["sifted_bits"] >= COUNT


def test_a_lower_threshold_is_kept(tmp_path: Path) -> None:
    physics = {"depolarizing": 0.03}
    failed = failure(tmp_path, "bb84", physics=physics, max_qber=0.02)
    assert "at most 0.0200 is allowed" in failed.alice


def test_too_few_bits_make_no_key(tmp_path: Path) -> None:
    failed = failure(tmp_path, "bb84", count=1000)
    assert "sift more photons" in failed.alice
    enough = re.search(r"some ([\d,]+) bits \(--count\)", failed.alice)
    assert enough, failed.alice
    (tmp_path / "enough").mkdir()
    alice, _bob = distribute(tmp_path / "enough", "bb84", count=int(enough[1].replace(",", "")))
    assert alice["key_bits"] > 0
    alice, _bob = distribute(tmp_path, "bb84", count=1000, bound="asymptotic")
    assert alice["key_bits"] > 256


class Tamperer:
    """Turns one bit of the first message of a kind that passes one way."""

    def __init__(self, way: str, kind: type[qkd.QkdMessage]) -> None:
        self._way, self._kind = way, kind
        self.changed = 0

    def __call__(self, way: str, message: Message) -> Message:
        if way != self._way or self.changed or not isinstance(message, Envelope):
            return message
        if message.topic != Topic.KEYS or message.content[3] != self._kind.KIND:
            return message
        self.changed = 1
        content = bytearray(message.content)
        content[qkd.HEADER.size] ^= 0x40
        return replace(message, content=bytes(content))


@pytest.mark.parametrize(
    ("way", "kind"),
    [
        ("back", qkd.Detections),
        ("forth", qkd.Sifted),
        ("forth", qkd.Sample),
        ("back", qkd.Disclosed),
        ("back", qkd.AskBlocks),
        ("forth", qkd.Parities),
        ("back", qkd.Verify),
        ("forth", qkd.Amplify),
        ("back", qkd.Confirm),
    ],
)
def test_a_message_that_was_tampered_with_ends_the_session_without_a_key(
    tmp_path: Path, way: str, kind: type[qkd.QkdMessage]
) -> None:
    tamperer = Tamperer(way, kind)
    failed = failure(tmp_path, "bb84", change=tamperer)
    assert tamperer.changed
    for text in (failed.alice, failed.bob):
        assert "no key" in text
        assert "the tag does not fit the message" in text


def test_another_proposal_than_the_openers_does_not_pass(tmp_path: Path) -> None:
    def change(way: str, message: Message) -> Message:
        if isinstance(message, Envelope) and message.content[3:4] == bytes([qkd.Proposal.KIND]):
            content = bytearray(message.content)
            content[-qkd.TAG_BYTES - 2] ^= qkd.Bound.FINITE ^ qkd.Bound.ASYMPTOTIC
            return replace(message, content=bytes(content))
        return message

    assert "the tag does not fit" in failure(tmp_path, "bb84", change=change).bob


def test_a_host_that_shares_no_secret_is_refused(tmp_path: Path) -> None:
    def change(way: str, message: Message) -> Message:
        if isinstance(message, Envelope) and message.topic == Topic.OPENER:
            return replace(message, content=b"mallory")
        return message

    failed = failure(tmp_path, "bb84", change=change)
    for text in (failed.alice, failed.bob):
        assert "bob shares no authentication key with 'mallory'" in text


def test_an_announcement_of_too_much_light_is_refused(tmp_path: Path) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), pairs=MAX_BLOCK_PAIRS)

    def change(way: str, message: Message) -> Message:
        if isinstance(message, Values) and message.topic == Topic.COMING:
            return values(message.session, Topic.COMING, message.block, [1 << 30], 32)
        return message

    assert f"at most {MAX_BLOCK_PAIRS} is known" in failure(tmp_path, "bb84", judge, change).bob


@protocols
@pytest.mark.parametrize(
    ("way", "kind"), [("forth", qkd.Sifted), ("back", qkd.Verify), ("back", qkd.Confirm)]
)
def test_when_the_other_end_is_gone_each_end_says_so_and_lets_go(
    tmp_path: Path, protocol: str, way: str, kind: type[qkd.QkdMessage]
) -> None:
    def change(towards: str, message: Message) -> Message | None:
        if towards == way and isinstance(message, Envelope) and message.content[3] == kind.KIND:
            return None
        return message

    failed = failure(tmp_path, protocol, change=change)
    assert "closed" in failed.alice
    assert "closed" in failed.bob


def test_light_that_does_not_come_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_light, "KEY_GRACE_S", 0.1)
    failed = failure(tmp_path, "bb84", physics={"paths": []})
    for text in (failed.alice, failed.bob):
        assert "no photon was measured by both ends: is a fibre cut" in text


def test_a_full_store_is_told_and_nothing_is_kept_at_either_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keyring, "CAPACITY", 3)
    monkeypatch.setattr(key_session, "CAPACITY_TIMEOUT_S", 0.3)
    failed = failure(tmp_path, "bb84")
    for text in (failed.alice, failed.bob):
        assert "bob: the store holds 3 keys" in text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"correction": "prayer"}, "correction 'prayer': choose one of cascade, ldpc"),
        ({"bound": "none"}, "bound 'none': choose one of finite, asymptotic"),
        ({"max_qber": 0.2}, "at 0.11 no key is secret, stay below"),
        ({"max_qber": "low"}, "max_qber 'low': choose a fraction between 0 and 1"),
        ({"epsilon": 0.0}, "epsilon 0.0: choose a fraction"),
        ({"test_fraction": 1.5}, "test_fraction 1.5"),
        ({"count": 2 * 10**12}, "count 2000000000000: choose 1 to 1000000000000"),
        ({"seconds": -1.0}, "seconds -1.0: choose up to 31622400, or 0 for a count"),
        ({"seconds": "long"}, "seconds 'long'"),
        ({"sifted_per_key": 2_000_000}, "sifted_per_key 2000000: choose 1 to 1000000"),
        ({"rate_hz": 100, "count": 10}, "take more than 5 s"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    assert words in refusal(tmp_path, "bb84", **options)


@protocols
def test_no_photon_is_left_behind(tmp_path: Path, protocol: str) -> None:
    async def run() -> int:
        async with network(tmp_path, paths=PATHS[protocol]):
            await asyncio.to_thread(one_session)
            return await live_qubits(tmp_path)

    def one_session() -> None:
        requested(tmp_path, protocol, count=COUNT)

    assert network_loop.run(run()) == 0


def weak(mean: float) -> dict[str, Any]:
    """Return the words for a network in which alice has a weak laser of this mean."""
    return {"devices": {"alice": Device(PairSource("poisson", mean))}}


def test_weak_pulses_are_detected_as_often_as_they_have_photons(tmp_path: Path) -> None:
    """A mean of m: seen with 1 - e^-m; several, all known to eve, with 1 - e^-m (1 + m)."""
    mean = 0.1
    options: dict[str, Any] = {"bound": "asymptotic", "count": 20_000}
    alice, bob = distribute(tmp_path, "bb84", physics=weak(mean), **options)
    seen, several = 1 - exp(-mean), 1 - exp(-mean) * (1 + mean)
    pulses = alice["photons"]
    assert abs(alice["raw_bits"] - pulses * seen) < 5 * sqrt(pulses * seen * (1 - seen))
    assert alice["qber"] == 0
    assert alice["multi_photon"] == bob["multi_photon"] == pytest.approx(several)
    single = 1 - pulses * several / 2 / alice["sifted_bits"]
    assert alice["single_photon_fraction"] == pytest.approx(single)
    kept = alice["sifted_bits"] - alice["disclosed_bits"]
    report = alice["leaked_bits"] + 128  # and the hash
    assert alice["key_bits"] == int(kept * single - report)
    assert "several photons" in alice["assumed"]


def test_weak_pulses_behind_much_loss_bring_no_key(tmp_path: Path) -> None:
    """Of a mean of .5 behind 10 dB each 20th is seen, and each 11th has several photons."""
    physics = weak(0.5) | {"connectors_db": 5.0}  # two fibres
    failed = failure(tmp_path, "bb84", physics=physics, bound="asymptotic", count=5_000)
    assert "several photons, which an eavesdropper can divide" in failed.alice + failed.bob


def test_decoys_bring_a_key_where_weak_pulses_alone_bring_none(tmp_path: Path) -> None:
    """The same means and loss: each 20th signal is seen. The key is of the basis X alone."""
    laser = PairSource("poisson", 0.5, decoys=(0.1, 0.0))
    physics = {"devices": {"alice": Device(laser)}, "connectors_db": 5.0}
    options: dict[str, Any] = {"bound": "asymptotic", "count": 40_000}
    alice, bob = distribute(tmp_path, "bb84", physics=physics, **options)
    assert alice["intensities"] == bob["intensities"] == [0.5, 0.1, 0.0]
    assert alice["qber"] == 0
    assert alice["key_bits"] == bob["key_bits"]
    sifted, tested = alice["sifted_bits"], alice["disclosed_bits"]
    assert abs(tested - sifted / 2) < 5 * sqrt(sifted / 4)
    # Of 90 % transmission lost, pulses of one photon: tau_1 .1 / sum of p (1 - e^(-.1 m)).
    means, shares = (0.5, 0.1, 0.0), (0.5, 0.35, 0.15)
    pairs = list(zip(means, shares, strict=True))
    ones = 0.1 * sum(p * m * exp(-m) for m, p in pairs)
    single = ones / sum(p * (1 - exp(-0.1 * m)) for m, p in pairs)
    assert 0.8 * single < alice["single_photon_fraction"] < 1.25 * single
    secret = alice["single_photon_fraction"] * (sifted - tested)
    assert 0 < alice["key_bits"] <= secret - alice["leaked_bits"] - 128 + 1
    assert "intensities nobody knows" in alice["assumed"]


def test_long_blocks_of_weak_pairs_make_a_key(tmp_path: Path) -> None:
    """Mean m, transmission t of either way: 1 - 2 e^-mt + e^-m(2t - tt) of pulses click twice.

    Half of these err, but for pulses of one pair alone of all that either end has seen.
    """
    mean, passes, pulses = 0.02, 0.1, 4_000_000
    physics = {"devices": {"charlie": Device(PairSource("poisson", mean))}, "connectors_db": 5.0}
    options: dict[str, Any] = {"block_pairs": pulses, "rate_hz": 1_000_000_000, "count": 2_000}
    alice, bob = distribute(tmp_path, "bbm92", physics=physics, bound="asymptotic", **options)
    dark, left = exp(-mean * passes), mean * passes * (2 - passes)
    twice, alone = 1 - 2 * dark + exp(-left), mean * passes**2 * exp(-left)
    clicks = alice["photons"] * (1 - dark)
    assert abs(bob["raw_bits"] - clicks) < 5 * sqrt(clicks)
    sifted = alice["photons"] * twice / 2
    assert abs(alice["sifted_bits"] - sifted) < 5 * sqrt(sifted)
    error, sample = (1 - alone / twice) / 2, alice["disclosed_bits"]
    assert abs(alice["qber"] - error) < 5 * sqrt(error * (1 - error) / sample)
    assert alice["key_bits"] == bob["key_bits"] > 0
