"""Services on nodes of other kinds than ideal light; within 5 standard errors, seed 1."""

import asyncio
from dataclasses import replace
from itertools import product
from math import exp, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stacks_scene import OWN_ADDRESS, RELAYED, ask, grant, hosts_file, network, refusal
from test_distribution_sessions import failed, inside

from hosts import network_loop
from hosts.hardware.simulated import SimulatedQnic
from hosts.middleware.services.distribution import protocol
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.values import Lifetimes, values
from hosts.service_socket import ServiceSocket
from hosts.stack import Stack
from hosts.stack_socket import QuantumSocketError
from topologies.catalogue.node_kinds import ION_TRAP, node_device
from wire.config import HostConfig
from wire.features import ABSORB, EMIT, GATE, HERALD, INTERFERE, MEASURE, STORE
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import Reason, Verdict
from wire.parameters.physics import Detectors, Device, Gates, Memory, PairSource

LASTING = Lifetimes(*[float("inf")] * 4).numbers()
IONS = replace(  # a faster one, and worse gates, so that a test is short and sees them
    ION_TRAP,
    source=PairSource(fidelity=0.96, max_rate_hz=1e9),
    memory=replace(ION_TRAP.memory, t2_s=1e6, capacity=2000, kind="absorptive"),
    gates=Gates("any", 0.02, 0.08),
)
PHOTONS = node_device("photonic", Device(source=PairSource(fidelity=0.98)))
PAIR = IONS.source.fidelity
P1, P2 = IONS.gates.one_qubit_depolarizing, IONS.gates.two_qubit_depolarizing
BELL_GATES = (1 - P1) * (1 - P2)  # what the two gates of a Bell measurement leave
CORRECTION = 1 - 0.75 * P1  # what a Pauli operator leaves that is the identity every fourth time
OWN = [(1, 2)]  # alice's fibre to bob's first
CHARLIE = [(4, 1), (5, 2)]


def polarised(fidelity: float) -> float:
    """Return how much of a Werner pair is Phi+, the rest being white noise."""
    return (4 * fidelity - 1) / 3


def fidelity(polarisation: float) -> float:
    """Return the fidelity of a Werner pair."""
    return (1 + 3 * polarisation) / 4


def everyone(device: Device, *between: str) -> dict[str, Device]:
    """Return the devices of ends, and hosts between them, that are alike."""
    return dict.fromkeys(("alice", *between, "bob"), device)


def require_estimate(summary: dict[str, Any], expected: float) -> None:
    """Hold the estimate of a fidelity against theory: F = (3 q - 1) / 2 of right outcomes."""
    right = (2 * expected + 1) / 3
    error = 1.5 * sqrt(right * (1 - right) / summary["sampled"])
    assert summary["sampled"] > 500
    assert abs(summary["fidelity"] - expected) < 5 * error, (summary["fidelity"], expected)


def scene(paths: list[tuple[int, int]], **devices: Device) -> dict[str, Any]:
    """Return the physics of a network with these light paths."""
    return {"devices": devices or everyone(IONS), "paths": paths, "analyser": "gates"}


def test_two_ion_traps_share_pairs_without_a_third_host(tmp_path: Path) -> None:
    physics = scene(OWN, alice=IONS, bob=IONS, charlie=Device(PairSource("none")))
    options: dict[str, Any] = {"count": 1000, "sample": 0.5, "source": "alice"}
    alice, bob = ask(tmp_path, "distribute", physics=physics, **options)
    assert alice["pairs"] == bob["pairs"] == 1000
    require_estimate(alice, PAIR)


def test_ion_traps_teleport_with_the_fidelity_that_their_gates_leave(tmp_path: Path) -> None:
    options: dict[str, Any] = {"count": 20_000, "block_pairs": 2000, "source": "alice"}
    alice, _bob = ask(tmp_path, "teleport", physics=scene(OWN), **options)
    pair = fidelity(polarised(PAIR) * BELL_GATES * CORRECTION)
    expected = (2 * pair + 1) / 3
    assert alice["arrived"] == 20_000
    assert abs(alice["fidelity"] - expected) < 5 * sqrt(expected * (1 - expected) / 20_000)


def test_ion_traps_take_the_pairs_of_a_photonic_source(tmp_path: Path) -> None:
    physics = scene(CHARLIE, alice=IONS, bob=IONS, charlie=PHOTONS)
    alice, _bob = ask(tmp_path, "distribute", physics=physics, count=1000, sample=0.5)
    require_estimate(alice, 0.98)


def purified(pair: float) -> float:
    """Return the fidelity after a round of DEJMPS, by noisy gates, of Werner pairs.

    An error of a pair is two bits: X, Z. Three gates on one qubit at either end depolarise each
    pair (the turn they make exchanges states that are alike); a CX at either end carries X from
    the kept pair to the one that is measured, and Z back, and with p2 leaves nothing of both.
    """
    kept = polarised(pair) * (1 - P1) ** 6
    error = [fidelity(kept), *[(1 - fidelity(kept)) / 3] * 3]
    passed = right = 0.0
    for one, other in product(range(4), repeat=2):
        share = error[one] * error[other]
        if not (one ^ other) & 1:
            passed += share
            right += share * (one ^ (other & 2) == 0)
    clean = (1 - P2) ** 2
    return (clean * right + (1 - clean) / 8) / (clean * passed + (1 - clean) / 2)


def test_ion_traps_purify_by_their_noisy_gates(tmp_path: Path) -> None:
    options: dict[str, Any] = {"count": 600, "sample": 0.6, "rounds": 1, "source": "alice"}
    alice, _bob = ask(tmp_path, "distribute", physics=scene(OWN), **options)
    assert alice["rounds"] == 1
    require_estimate(alice, purified(PAIR))


def test_the_wait_in_an_ion_trap_dephases_what_waits(tmp_path: Path) -> None:
    """One block, because a mean over different waits is more than that of the mean wait."""
    forgetful = replace(IONS, memory=Memory(t1_s=1e6, t2_s=0.05, capacity=40_000), gates=Gates())
    physics = scene(OWN, **everyone(replace(forgetful, source=PairSource())))
    options: dict[str, Any] = {"count": 20_000, "block_pairs": 20_000, "source": "alice"}
    _alice, bob = ask(tmp_path, "teleport", physics=physics, **options)
    longest = 1 / 3 + 2 / 3 * (1 + exp(-bob["waited_ms"] / 1000 / 0.05)) / 2
    assert bob["fidelity"] < longest + 0.01  # alice's half has waited as well


def test_blocks_fit_the_smaller_memory_though_larger_ones_were_asked_for(tmp_path: Path) -> None:
    """As the controller has granted it: what it writes into the set-up, bob tells alice."""
    small = replace(IONS, memory=replace(IONS.memory, capacity=32))

    def judge(setup: Setup) -> Setup:
        return replace(grant(setup), pairs=min(setup.pairs, 32))

    physics = scene(OWN, alice=IONS, bob=small)
    alice, _bob = ask(tmp_path, "teleport", judge, physics, count=500, source="alice")
    assert alice["arrived"] == 500


@pytest.mark.parametrize("who", ["alice", "bob"])
def test_pairs_are_kept_only_as_many_as_the_smaller_memory_takes(tmp_path: Path, who: str) -> None:
    small = replace(IONS, memory=replace(IONS.memory, capacity=32))
    physics = scene(OWN, **{**everyone(IONS), who: small})
    options: dict[str, Any] = {"count": 20, "block_pairs": 32, "source": "alice"}
    alice, bob = ask(tmp_path, "distribute", physics=physics, **options)
    assert alice["pairs"] == bob["pairs"] == 20
    # Pairs that were not needed were sacrificed: a tenth would be 30 of 300 pairs, and not fit.
    assert 30 <= alice["sampled"] <= alice["shared"] - 20 < 100


@pytest.mark.parametrize("capacity", [32, 4000])
def test_few_pairs_cost_few_more_than_their_sample(tmp_path: Path, capacity: int) -> None:
    """Nothing is lost: 12 pairs and the 30 of the least sample, 5 % more, and one a block."""
    ions = replace(IONS, memory=replace(IONS.memory, capacity=capacity))
    physics = scene(OWN, **everyone(ions))
    options: dict[str, Any] = {"count": 12, "source": "alice"}
    alice, bob = ask(tmp_path, "distribute", physics=physics, **options)
    assert alice["pairs"] == 12
    assert alice["sampled"] >= 30
    assert 42 <= alice["emitted"] <= 42 * 1.05 + 4
    for end in (alice, bob):
        assert 0 <= end["fidelity_age_s"] <= end["elapsed_s"]
        # Of ions that keep for days: a minute of the machine takes less.
        assert end["fidelity_expected"] == pytest.approx(end["fidelity"], rel=1e-4)


def test_the_fidelity_at_delivery_is_that_of_the_sample_decayed_since(tmp_path: Path) -> None:
    """T2 alone, of perfect pairs: 1/2 + (F - 1/2) e^(-t/T2) e^(-t/T2') after the age t."""
    ions, more = (
        replace(IONS, memory=replace(IONS.memory, t1_s=np.inf, t2_s=t2_s)) for t2_s in (2.0, 5.0)
    )
    physics = scene(OWN, alice=ions, bob=more)
    ends = ask(tmp_path, "distribute", physics=physics, count=200, source="alice")
    for end in ends:
        kept = np.exp(-end["fidelity_age_s"] * (1 / 2.0 + 1 / 5.0))
        expected = 0.5 + (end["fidelity"] - 0.5) * kept
        assert end["fidelity_expected"] == pytest.approx(expected, rel=1e-6)
        assert end["fidelity_expected"] < end["fidelity"]


def test_the_last_places_of_a_memory_are_enough_to_purify_and_to_estimate(tmp_path: Path) -> None:
    small = replace(IONS, memory=replace(IONS.memory, capacity=16), gates=Gates())
    physics = scene(OWN, **everyone(small))
    options: dict[str, Any] = {"count": 14, "block_pairs": 16, "rounds": 1, "source": "alice"}
    alice, _bob = ask(tmp_path, "distribute", physics=physics, **options)
    assert alice["pairs"] == 14
    assert alice["sampled"] >= 30


def test_purification_that_memories_have_no_room_for_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(protocol, "LEAST_JUDGED", 100)  # as there is room to sample one at a time
    small = replace(IONS, memory=replace(IONS.memory, capacity=16), gates=Gates())
    physics = scene(OWN, **everyone(small))
    options: dict[str, Any] = {"count": 15, "block_pairs": 16, "fidelity": 0.999}
    words = "15 pairs and 2 more, to estimate or purify, do not fit into the memory"
    with pytest.raises(QuantumSocketError, match=words):
        ask(tmp_path, "distribute", physics=physics, source="alice", **options)


def error(folder: Path, physics: dict[str, Any], **options: Any) -> str:
    """Ask for a distribution that cannot be; return why, as both ends hear it."""

    def failed() -> str:
        with ServiceSocket(folder / "bob.sock") as bob, ServiceSocket(folder / "alice.sock") as one:
            for socket in (bob, one):
                socket.settimeout(20)
            bob.listen(9, "distribute")
            with pytest.raises(QuantumSocketError) as caught:
                list(one.request("distribute", ("bob", 9), source="alice", **options))
        return str(caught.value)

    async def run() -> str:
        async with network(folder, **physics):
            return await asyncio.to_thread(failed)

    return network_loop.run(run())


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ([0, 15, 100, *LASTING], "blocks of 0 pairs, 16384 were asked for"),
        ([16_385, 15, 100, *LASTING], "blocks of 16385 pairs"),
        ([100, 128, 100, *LASTING], "features 0x80, of which 0x7f exist"),
        ([100, 1 << 20, 100, *LASTING], "features 0x100000"),
        ([100, 13, 100, *LASTING], "emit, gate, measure with a memory of 100 qubits"),
        ([100, 15, 0, *LASTING], "with a memory of 0 qubits"),
        ([100, 15, 100, 0, *LASTING[1:]], "memory with t1_s 0.0"),
        ([100, 15, 100, 0x7FC0_0000, *LASTING[1:]], "memory with t1_s nan"),
        ([100, 15], f"2 values of topic {Topic.NODE_FEATURES}"),
    ],
)
def test_abilities_that_no_host_has_end_the_session(
    tmp_path: Path, numbers: list[int], words: str
) -> None:
    def change(way: str, message: Message) -> Message:
        if way == "back" and isinstance(message, Values) and message.topic == Topic.NODE_FEATURES:
            return values(message.session, Topic.NODE_FEATURES, 0, numbers, 32)
        return message

    physics = {**scene(OWN), "change": change}
    assert words in error(tmp_path, physics, count=100)


CANNOT = [
    (
        {"alice": ION_TRAP, "bob": IONS},
        {"count": 50},
        "50 pairs and 1 more, to estimate or purify, do not fit into the memory of alice, "
        "32 qubits: ask for at most 31",
    ),
    (
        {"alice": IONS, "bob": ION_TRAP},
        {"count": 29, "rounds": 2},
        "29 pairs and 4 more, to estimate or purify, do not fit into the memory of bob, 32 qubits",
    ),
    (
        {"alice": IONS, "bob": ION_TRAP},
        {"count": 33, "sample": 0},
        "33 pairs do not fit into the memory of bob, 32 qubits: ask for at most 32",
    ),
    (
        {"alice": IONS, "bob": PHOTONS},
        {"count": 10, "rounds": 1},
        "purification needs the feature gate, measure at both ends, and bob has only emit, store, "
        "measure, interfere, absorb: ask for less fidelity",
    ),
    (
        {"alice": PHOTONS, "bob": IONS},
        {"count": 10, "fidelity": 0.99, "rounds": 2},
        "purification needs the feature gate, measure at both ends, and alice has",
    ),
    (
        {"alice": IONS, "bob": replace(IONS, detectors=Detectors(efficiency=0.0))},
        {"count": 10},
        "an estimate needs the feature measure at both ends, and bob has only emit, store, gate, "
        "herald, absorb: choose sample 0",
    ),
]


@pytest.mark.parametrize(("devices", "options", "words"), CANNOT)
def test_what_the_ends_cannot_do_is_told_by_host_and_feature(
    tmp_path: Path, devices: dict[str, Device], options: dict[str, Any], words: str
) -> None:
    assert words in error(tmp_path, scene(OWN, **devices), **options)


def test_purification_that_turns_out_to_be_needed_needs_gates_at_both_ends(tmp_path: Path) -> None:
    def happening() -> None:
        for error in failed(tmp_path, count=100, fidelity=0.99, sample=0.8, source="alice"):
            assert "purification needs the feature gate, measure at both ends" in str(error)
            assert error.reason == Reason.UNSUPPORTED

    inside(tmp_path, happening, **scene(OWN, alice=PHOTONS, bob=IONS))


@pytest.mark.parametrize(
    ("reason", "words"),
    [
        (Reason.CANNOT_EMIT, "distribute: charlie has no source of light (feature emit)"),
        (Reason.CANNOT_STORE, "distribute: charlie has no memory, or one that is too small"),
        (Reason.CANNOT_GATE, "distribute: charlie has no gates but Pauli operators"),
        (Reason.CANNOT_MEASURE, "distribute: charlie has no detectors that click"),
    ],
)
def test_who_asks_hears_which_host_lacks_what(tmp_path: Path, reason: Reason, words: str) -> None:
    def judge(setup: Setup) -> Setup:
        return replace(setup, verdict=Verdict.REFUSED, reason=reason, source=RELAYED["charlie"])

    text = refusal(tmp_path, "distribute", judge)
    assert words in text
    assert "take another host in its place, or give it" in text


def test_who_asks_hears_which_element_is_in_the_way(tmp_path: Path) -> None:
    def judge(setup: Setup) -> Setup:
        refused = replace(setup, verdict=Verdict.REFUSED, reason=Reason.PATH_BROKEN)
        return replace(refused, obstacle="fibre q1-q2 is cut")

    text = refusal(tmp_path, "distribute", judge)
    assert text == "no light path from 127.0.0.1 to bob: fibre q1-q2 is cut"  # of the relay


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"source": "bob"}, "bbm92 with pairs of bob, one of its ends: name another host"),
        ({"source": "alice"}, "bbm92 with pairs of alice, one of its ends"),
        ({"source": "zoe"}, "unknown host 'zoe': choose one of alice"),
        ({"source": 7}, "source 7 is not a name"),
    ],
)
def test_a_source_that_cannot_be_is_refused_before_anything_is_sent(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    assert words in refusal(tmp_path, "bbm92", **options)


def test_the_kinds_differ_in_what_they_can_do() -> None:
    assert ION_TRAP.features == STORE | GATE | MEASURE | HERALD
    assert PHOTONS.features == EMIT | STORE | ABSORB | MEASURE | INTERFERE


def test_who_asks_hears_that_no_host_makes_pairs(tmp_path: Path) -> None:
    config = HostConfig(
        name="alice",
        address=OWN_ADDRESS["alice"],
        qnics=[],
        dispatcher=f"unix:{tmp_path}/dispatcher.sock",
        token="of alice",
        socket=str(tmp_path / "alice.sock"),
        hosts_file=str(hosts_file(tmp_path)),
        source="",  # no QuantumHost has source=True
        seed=1,
    )

    async def run() -> None:
        stack = Stack(config, SimulatedQnic(config.dispatcher, config.token, config.qnics))
        with pytest.raises(SessionError, match="no host of this network makes pairs"):
            stack.request({"service": "distribute", "host": "bob", "port": 9})

    network_loop.run(run())
