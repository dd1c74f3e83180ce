"""GHZ states between whole stacks over loopback, against an enumeration with state vectors."""

import asyncio
from functools import reduce
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from line_scene import LINE, MEMORIES, PATHS, five_t2_late, summaries
from numpy.typing import NDArray
from stacks_scene import live_qubits, network

from applications.ghz.line import most_states
from applications.ghz.witness import Tally, X, Y, Z, chosen_bases
from hosts import network_loop
from hosts.middleware.session.values import values
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.metadata.decoding import message_length
from wire.metadata.header import MAX_LENGTH
from wire.metadata.values import Topic
from wire.parameters.physics import Detectors, Device

COUNT = 20_000
PAULIS = [
    np.eye(2),
    np.array([[0, 1], [1, 0]]),
    np.diag([1, -1]),
    np.array([[0, 1], [-1, 0]]),
]


def on(qubits: int, **operators: NDArray[Any]) -> NDArray[Any]:
    """Return operators on some of a number of qubits, called q0, q1 and so on."""
    return reduce(np.kron, [operators.get(f"q{each}", np.eye(2)) for each in range(qubits)])


def fidelity(hosts: int, p: float) -> float:
    """Return the fidelity where each half that is sent is depolarised, by the circuit itself.

    Qubits are the halves, pair after pair; of each pair q(2i) stays and q(2i+1) is sent.
    """
    pairs, qubits = hosts - 1, 2 * (hosts - 1)
    bell = np.array([1, 0, 0, 1]) / np.sqrt(2)
    pure, zero, one = reduce(np.kron, [bell] * pairs), np.diag([1, 0]), np.diag([0, 1])
    kept = [0, *range(1, qubits, 2)]  # one half of each host; the others are measured
    total = 0.0
    for errors in product(range(4), repeat=pairs):
        share = np.prod([p / 4 if error else 1 - 3 * p / 4 for error in errors])
        state = pure
        for pair, error in enumerate(errors):
            state = on(qubits, **{f"q{2 * pair + 1}": PAULIS[error]}) @ state
        for pair in range(1, pairs):  # CX from what came to its own half
            came, own = f"q{2 * pair - 1}", f"q{2 * pair}"
            flip = on(qubits, **{came: one, own: PAULIS[1]})
            state = (on(qubits, **{came: zero}) + flip) @ state
        for bits in product((0, 1), repeat=pairs - 1):
            found = {f"q{2 * pair}": (zero, one)[bit] for pair, bit in enumerate(bits, 1)}
            flips, turned = 0, dict[str, NDArray[Any]]()
            for pair, bit in enumerate(bits, 1):
                flips ^= bit
                turned[f"q{2 * pair + 1}"] = PAULIS[flips]
            after = on(qubits, **turned) @ on(qubits, **found) @ state
            # Onto |0...0> + |1...1> of what is kept, in the outcome that the others have.
            places = [[0] * qubits, [0] * qubits]
            for pair, bit in enumerate(bits, 1):
                places[0][2 * pair] = places[1][2 * pair] = bit
            for each in kept:
                places[1][each] = 1
            amplitudes = [after[int("".join(map(str, place)), 2)] for place in places]
            total += share * abs(sum(amplitudes)) ** 2 / 2
    return float(total)


def made(folder: Path, hosts: int, count: int = COUNT, **physics: Any) -> list[dict[str, Any]]:
    """Return the summaries of all hosts, in their order."""
    return summaries(folder, "ghz", LINE[:hosts], {"count": count}, **physics)


@pytest.mark.parametrize("hosts", [3, 4])
def test_states_over_perfect_fibers_are_ghz_states(tmp_path: Path, hosts: int) -> None:
    alice, *others = made(tmp_path, hosts, count=2000)
    assert (alice["fidelity"], alice["states"], alice["emitted"]) == (1, 2000, 2000)
    assert [each["fused"] for each in others] == [2000] * (hosts - 2) + [0]


@pytest.mark.parametrize("hosts", [3, 4])
def test_fibers_that_depolarise_leave_the_fidelity_of_an_enumeration(
    tmp_path: Path, hosts: int
) -> None:
    alice, *_others = made(tmp_path, hosts, depolarizing=0.05)
    expected = fidelity(hosts, 1 - 0.95**2)  # host to switch, switch to host
    assert abs(alice["fidelity"] - expected) < 5 * alice["fidelity_error"]
    assert alice["fidelity_error"] < 0.006


def test_the_enumeration_has_the_closed_form_of_pauli_errors() -> None:
    """All are equal in Z if no link flips a bit, and coherent if none turns the phase either."""
    for hosts, p in product((2, 3, 4), (0.0, 0.1, 0.4)):
        links = hosts - 1
        assert fidelity(hosts, p) == pytest.approx(((1 - p / 2) ** links + (1 - p) ** links) / 2)


@pytest.mark.parametrize("behind", [1, 2, 3, 15])
def test_one_message_tells_of_all_states_of_a_block(behind: int) -> None:
    numbers = np.full(behind * most_states(behind), 3, dtype=np.uint8)
    message = values(1, Topic.OUTCOMES, 1, numbers, 2).encode()
    assert 0.99 * MAX_LENGTH < len(message) <= MAX_LENGTH
    assert message_length(message) == len(message)


def test_light_that_is_lost_costs_states_and_no_fidelity(tmp_path: Path) -> None:
    alice, *_others = made(tmp_path, 3, count=3000, loss_db_per_km=150.0)
    arrives = 10 ** (-2 * 1.5 / 10)  # two fibres of 10 m to each host
    assert alice["fidelity"] == 1
    share = alice["made"] / alice["emitted"]
    spread = np.sqrt(arrives**2 * (1 - arrives**2) / alice["emitted"])
    assert abs(share - arrives**2) < 5 * spread


def test_where_a_fusion_is_not_seen_there_is_no_state(tmp_path: Path) -> None:
    devices = {"bob": Device(detectors=Detectors(efficiency=0.5))}
    alice, bob, _charlie = made(tmp_path, 3, count=1000, devices=devices)
    assert alice["fidelity"] == 1
    spread = np.sqrt(0.25 / bob["fused"])
    assert abs(alice["made"] / bob["fused"] - 0.5) < 5 * spread  # of which bob then sees half
    assert abs(alice["states"] / alice["made"] - 0.5) < 5 * np.sqrt(0.25 / alice["made"])


def test_qubits_wait_in_memory_until_they_are_used(tmp_path: Path) -> None:
    """Bob and charlie hear the bases 5 T2 late: e^-10 of the coherence is left; Z stays."""
    late = {"devices": MEMORIES, "change": five_t2_late}
    alice, *_others = made(tmp_path, 3, count=4000, **late)
    assert alice["equal_in_z"] == 1
    assert abs(alice["coherence"]) < 5 / np.sqrt(2000)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("alice", "name 2 to 16, each once"),
        ("alice,bob,bob", "name 2 to 16, each once"),
        ("alice,charlie,bob", "bob is asked, so it has to be the second"),
        ("alice,bob,zoe", "bob knows no host zoe"),
        ("alice,bob,charlie", "no application listens on port 9"),
    ],
)
def test_a_line_that_cannot_be_is_refused_and_leaves_no_photon(
    tmp_path: Path, line: str, words: str
) -> None:
    def refused() -> str:
        with (
            ServiceSocket(tmp_path / "alice.sock") as asking,
            ServiceSocket(tmp_path / "bob.sock") as listener,
        ):
            asking.settimeout(SOON_S)
            listener.listen(9, "ghz")
            with pytest.raises(QuantumSocketError) as caught:
                list(asking.request("ghz", ("bob", 9), count=10, line=line))
        return str(caught.value)

    async def run() -> str:
        async with network(tmp_path, paths=PATHS):
            text = await asyncio.to_thread(refused)
            assert await live_qubits(tmp_path) == 0
            return text

    assert words in network_loop.run(run())


def test_bases_are_those_of_stabilisers_each_as_often_as_others() -> None:
    """Z at all hosts for half of the states, else an even number of Y: four ways for three."""
    bases = chosen_bases(np.random.default_rng(1), 3, 80_000)
    in_z = (bases == Z).all(axis=0)
    assert ((bases == Z).any(axis=0) == in_z).all()
    ways, counts = np.unique(bases[:, ~in_z], axis=1, return_counts=True)
    assert sorted(map(tuple, ways.T)) == sorted([(X, X, X), (X, Y, Y), (Y, X, Y), (Y, Y, X)])
    for count, share in ((in_z.sum(), 1 / 2), *((each, 1 / 8) for each in counts)):
        assert abs(count / 80_000 - share) < 5 * np.sqrt(share * (1 - share) / 80_000)


def test_outcomes_that_nobody_has_seen_tell_nothing() -> None:
    tally = Tally()
    bases = np.array([[Z, Z, X, Y], [Z, Z, X, Y], [Z, Z, X, X]], dtype=np.uint8)
    outcomes = np.array([[0, 3, 1, 1], [0, 0, 1, 0], [0, 0, 0, 0]], dtype=np.uint8)
    tally.add(bases, outcomes)
    assert (tally.in_z, tally.equal, tally.in_x, tally.right) == (1, 1, 2, 2)
    assert tally.summary()["fidelity"] == 1
