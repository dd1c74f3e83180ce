"""Programs of NetQASM's SDK on whole stacks, with a real dispatcher."""

import asyncio
import json
import socket
import threading
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from netqasm.lang.instr import vanilla
from netqasm.sdk import EPRSocket, Qubit
from netqasm.sdk.epr_socket import EprMeasBasis
from netqasm_scene import EXAMPLES, outputs
from stacks_scene import network

from applications.processing_unit import machine, pairs
from hosts import network_loop
from hosts.stack_socket import QuantumSocketError
from wire.socket_calls import HEADER, Call, decode_fields, decode_header, encode, encode_fields

TWO = {"alice": "alice", "bob": "bob"}
# Each second one is of another axis, and they are not all opposite ones.
BASES = [EprMeasBasis[name] for name in ("Y", "Z", "MZ", "MX", "X", "MY")]
GATES = {
    "X": vanilla.GateXInstruction,
    "Y": vanilla.GateYInstruction,
    "Z": vanilla.GateZInstruction,
    "H": vanilla.GateHInstruction,
    "S": vanilla.GateSInstruction,
    "K": vanilla.GateKInstruction,
    "T": vanilla.GateTInstruction,
}
TO_STATE = {"0": "", "1": "X", "+": "H", "-": "XH", "+i": "K", "-i": "XK"}
TO_BASIS = {"Z": "", "X": "H", "Y": "K"}


def connection(role: str, config: Any, **words: Any) -> Any:
    """Return a connection as programs make it, who import it late for our own to be there."""
    from netqasm.sdk.external import NetQASMConnection

    return NetQASMConnection(role, log_config=config.log_config, **words)


def matrix(name: str) -> Any:
    """Return what the SDK says that a gate is."""
    return GATES[name]().to_matrix()


def test_gates_do_what_the_sdk_says_wherever_that_is_certain(tmp_path: Path) -> None:
    cases, expected = [], []
    for (_, before), gates, (_, after) in product(
        TO_STATE.items(), [*"XYZHSK", "TT"], TO_BASIS.items()
    ):
        state = np.array([1, 0], dtype=complex)
        for name in before + gates + after:
            state = matrix(name) @ state
        if abs(abs(state[0]) ** 2 - 0.5) > 0.4:
            cases.append(before + gates + after)
            expected.append(round(abs(state[1]) ** 2))
    assert len(cases) == 6 * 7  # each state is certain in one basis, before and after

    def alice(app_config: Any = None) -> list[int]:
        with connection("alice", app_config) as unit:
            outcomes = []
            for gates in cases:
                qubit = Qubit(unit)
                for name in gates:
                    getattr(qubit, name)()
                outcomes.append(qubit.measure())
        return [int(each) for each in outcomes]

    (report,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"})
    assert report["alice"] == expected


def test_rotations_add_up_to_what_is_certain(tmp_path: Path) -> None:
    """Seven and nine sixteenths of pi about one axis are a flip, or nothing about another."""

    def alice(app_config: Any = None) -> list[int]:
        with connection("alice", app_config) as unit:
            outcomes = []
            for turn in ("rot_X", "rot_Y", "rot_Z"):
                qubit = Qubit(unit)
                for numerator in (7, 9):
                    getattr(qubit, turn)(n=numerator, d=4)
                outcomes.append(qubit.measure())
        return [int(each) for each in outcomes]

    (report,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"})
    assert report["alice"] == [1, 1, 0]


def test_what_was_measured_stays_and_branches_see_it(tmp_path: Path) -> None:
    def alice(app_config: Any = None) -> list[tuple[int, ...]]:
        report = []
        with connection("alice", app_config) as unit:
            for _ in range(20):
                coin, other = Qubit(unit), Qubit(unit)
                coin.H()
                first = coin.measure(inplace=True)
                with first.if_eq(1):
                    other.X()
                report.append((first, coin.measure(), other.measure()))
            unit.flush()
            return [tuple(int(each) for each in row) for row in report]

    (report,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"})
    assert set(report["alice"]) == {(0, 0, 0), (1, 1, 1)}


def test_loops_run_in_the_unit(tmp_path: Path) -> None:
    def alice(app_config: Any = None) -> list[int]:
        with connection("alice", app_config) as unit:
            outcomes = unit.new_array(8)
            with unit.loop(8) as i:
                qubit = Qubit(unit)
                qubit.X()
                qubit.measure(future=outcomes.get_future_index(i))
            unit.flush()
            return [int(outcomes.get_future_index(i)) for i in range(8)]

    (report,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"})
    assert report["alice"] == [1] * 8


def keep(role: str, peer: str, creates: bool, gates: str, pairs: int) -> Any:
    """Return a program that keeps pairs, does gates to its halves, and measures them."""

    def program(app_config: Any = None) -> list[int]:
        pairs_of = EPRSocket(peer)
        with connection(role, app_config, epr_sockets=[pairs_of], max_qubits=pairs) as unit:
            asked = pairs_of.create_keep if creates else pairs_of.recv_keep
            outcomes = []
            for half in asked(pairs):
                for name in gates:
                    getattr(half, name)()
                outcomes.append(half.measure())
            unit.flush()
            return [int(each) for each in outcomes]

    return program


@pytest.mark.parametrize("basis", "XYZ")
def test_pairs_that_are_kept_are_phi_plus(tmp_path: Path, basis: str) -> None:
    programs = {
        "alice": keep("alice", "bob", True, TO_BASIS[basis], 40),
        "bob": keep("bob", "alice", False, TO_BASIS[basis], 40),
    }
    (report,) = outputs(tmp_path, programs, TWO)
    assert {0, 1} == set(report["alice"])
    flip = basis == "Y"
    assert report["bob"] == [outcome ^ flip for outcome in report["alice"]]


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("basis", BASES)
def test_pairs_that_are_measured_at_once_are_phi_plus(tmp_path: Path, basis: EprMeasBasis) -> None:
    def alice(app_config: Any = None) -> list[int]:
        pairs = EPRSocket("bob")
        with connection("alice", app_config, epr_sockets=[pairs]):
            report = pairs.create_measure(20, basis_local=basis, basis_remote=EprMeasBasis.MZ)
            again = pairs.create_measure(20, basis_local=basis, basis_remote=basis)
        return [int(each.raw_measurement_outcome) for each in (*report, *again)]

    def bob(app_config: Any = None) -> list[int]:
        pairs = EPRSocket("alice")
        with connection("bob", app_config, epr_sockets=[pairs]):
            report = [*pairs.recv_measure(20), *pairs.recv_measure(20)]
        return [int(each.raw_measurement_outcome) for each in report]

    (report,) = outputs(tmp_path, {"alice": alice, "bob": bob}, TWO)
    ours, theirs = np.array(report["alice"]), np.array(report["bob"])
    flip = basis.name in ("Y", "MY")  # of Phi+ the outcomes in Y differ
    assert (ours[20:] ^ theirs[20:] == flip).all()
    crossed = ours[:20] ^ theirs[:20]  # with the opposite of Z
    if basis.name in ("Z", "MZ"):
        assert (crossed == (basis.name == "Z")).all()
    else:
        assert {0, 1} == set(crossed)  # 20 coins are alike once in 5e5 times


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("basis", BASES)
def test_what_the_creator_finds_is_what_the_receiver_has(
    tmp_path: Path, basis: EprMeasBasis
) -> None:
    """Remote state preparation: of Phi+ the other half has the state found, conjugated."""
    axis, opposite = basis.name[-1], basis.name.startswith("M")

    def alice(app_config: Any = None) -> list[int]:
        pairs = EPRSocket("bob")
        with connection("alice", app_config, epr_sockets=[pairs]):
            report = pairs.create_rsp(20, basis_local=basis)
        return [int(each.raw_measurement_outcome) for each in report]

    def bob(app_config: Any = None) -> list[int]:
        pairs = EPRSocket("alice")
        with connection("bob", app_config, epr_sockets=[pairs], max_qubits=20) as unit:
            outcomes = []
            for half in pairs.recv_rsp(20):
                for name in TO_BASIS[axis]:
                    getattr(half, name)()
                outcomes.append(half.measure())
            unit.flush()
            return [int(each) for each in outcomes]

    (report,) = outputs(tmp_path, {"alice": alice, "bob": bob}, TWO)
    flip = (axis == "Y") ^ opposite
    assert report["bob"] == [outcome ^ flip for outcome in report["alice"]]


def test_programs_run_again_and_again(tmp_path: Path) -> None:
    programs = {
        "alice": keep("alice", "bob", True, "", 2),
        "bob": keep("bob", "alice", False, "", 2),
    }
    results = outputs(tmp_path, programs, TWO, rounds=5)
    assert len(results) == 5
    assert all(each["alice"] == each["bob"] for each in results)


def test_a_number_is_used_for_one_pair_after_the_other(tmp_path: Path) -> None:
    def sequential(role: str, peer: str, creates: bool) -> Any:
        def program(app_config: Any = None) -> list[int]:
            pairs = EPRSocket(peer)
            with connection(role, app_config, epr_sockets=[pairs], max_qubits=1) as unit:
                outcomes = unit.new_array(6)

                def measured(_unit: Any, half: Any, number: Any) -> None:
                    half.H()
                    half.measure(future=outcomes.get_future_index(number))

                asked = pairs.create_keep if creates else pairs.recv_keep
                asked(6, post_routine=measured, sequential=True)
                unit.flush()
                return [int(outcomes.get_future_index(i)) for i in range(6)]

        return program

    programs = {
        "alice": sequential("alice", "bob", True),
        "bob": sequential("bob", "alice", False),
    }
    (report,) = outputs(tmp_path, programs, TWO)
    assert report["alice"] == report["bob"]


def in_portions(role: str, peer: str, creates: bool, portions: list[int], use: str) -> Any:
    """Return a program that requests pairs in portions, one flush each; it returns all outcomes."""

    def program(app_config: Any = None) -> list[int]:
        pairs_of = EPRSocket(peer)
        with connection(role, app_config, epr_sockets=[pairs_of], max_qubits=9) as unit:
            asked = getattr(pairs_of, f"{'create' if creates else 'recv'}_{use}")
            outcomes: list[Any] = []
            for pairs in portions:
                halves = asked(pairs)
                outcomes += halves if use == "measure" else [half.measure() for half in halves]
                unit.flush()
        if use == "measure":
            outcomes = [half.raw_measurement_outcome for half in outcomes]
        return [int(each) for each in outcomes]

    return program


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("use", ["keep", "measure"])
@pytest.mark.parametrize(("ours", "theirs"), [([1, 1], [2]), ([3, 5], [1, 6, 1]), ([8], [1] * 8)])
def test_pairs_are_counted_one_by_one_at_both_ends(
    tmp_path: Path, ours: list[int], theirs: list[int], use: str
) -> None:
    """As NetQASM's Executor does; the outcomes of Phi+ along Z are the same, pair by pair."""
    programs = {
        "alice": in_portions("alice", "bob", True, ours, use),
        "bob": in_portions("bob", "alice", False, theirs, use),
    }
    results = outputs(tmp_path, programs, TWO, rounds=3)
    assert [each["bob"] for each in results] == [each["alice"] for each in results]
    assert len(results[0]["alice"]) == sum(ours)


def test_pairs_that_the_other_end_does_not_receive_are_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pairs, "WANTED_TIMEOUT_S", 1.0)

    def wants_more(app_config: Any = None) -> str:
        with pytest.raises(QuantumSocketError) as caught:
            in_portions("alice", "bob", True, [3], "keep")(app_config=app_config)
        return str(caught.value)

    programs = {"alice": wants_more, "bob": in_portions("bob", "alice", False, [2], "keep")}
    (report,) = outputs(tmp_path, programs, TWO)
    assert len(report["bob"]) == 2
    assert "1 pairs with bob: the other end has not asked to receive them" in report["alice"]


@pytest.mark.parametrize("early", ["alice", "bob"])
def test_a_gate_waits_for_a_pair_on_its_way(tmp_path: Path, early: str) -> None:
    """With a single qubit the SDK does not wait for a pair; the state of half of Phi+ is mixed."""

    def program(role: str, peer: str, creates: bool) -> Any:
        def run(app_config: Any = None) -> Any:
            from netqasm.sdk.external import Socket, get_qubit_state

            texts, pairs_of = Socket(role, peer), EPRSocket(peer)
            asked = pairs_of.create_keep if creates else pairs_of.recv_keep
            with connection(role, app_config, epr_sockets=[pairs_of], max_qubits=1) as unit:
                if role != early:
                    texts.recv()
                (half,) = asked()
                unit.flush()
                texts.send("requested")
                mixed = get_qubit_state(half)
                texts.send("seen")
                while texts.recv() != "seen":  # nobody measures before
                    pass
                half.X()
                outcome = half.measure()
            return [int(outcome), mixed]

        return run

    programs = {
        "alice": program("alice", "bob", creates=True),
        "bob": program("bob", "alice", creates=False),
    }
    (report,) = outputs(tmp_path, programs, TWO, state_inspection=True)
    assert report["alice"][0] == report["bob"][0]
    for _outcome, mixed in report.values():
        assert np.allclose(mixed, np.eye(2) / 2)


def test_a_pair_takes_as_long_as_its_light_at_both_ends(tmp_path: Path) -> None:
    """A source of 50 MHz makes 200 pairs in 4 us, and those of a margin: twice as many at most.

    The last pair of a request in two portions comes after the light of both.
    """

    def durations(role: str, peer: str, creates: bool, portions: list[int]) -> Any:
        def program(app_config: Any = None) -> list[int]:
            pairs_of = EPRSocket(peer)
            with connection(role, app_config, epr_sockets=[pairs_of]):
                asked = pairs_of.create_measure if creates else pairs_of.recv_measure
                report = [asked(number)[-1] for number in portions]
            return [int(each.generation_duration) for each in report]

        return program

    programs = {
        "alice": durations("alice", "bob", True, [200, 100, 100]),
        "bob": durations("bob", "alice", False, [200, 200]),
    }
    (report,) = outputs(tmp_path, programs, TWO)
    first, second, third = report["alice"]
    assert 4 <= first <= 8
    assert 2 <= second <= 4
    assert report["bob"] == [first, second + third]


@pytest.mark.parametrize("sequential", [False, True])
def test_pairs_that_are_good_enough_at_the_end_are_kept(tmp_path: Path, sequential: bool) -> None:
    """The SDK turns a fidelity of 95 % into 14.5 ms at most: light of two pairs takes 1 us."""

    def program(role: str, peer: str, creates: bool) -> Any:
        def run(app_config: Any = None) -> list[int]:
            pairs_of = EPRSocket(peer)
            with connection(role, app_config, epr_sockets=[pairs_of]) as unit:
                asked = pairs_of.create_keep if creates else pairs_of.recv_keep
                outcomes = unit.new_array(2)

                def measure(_unit: Any, half: Any, number: Any) -> None:
                    half.measure(future=outcomes.get_future_index(number))

                words = {"sequential": True, "post_routine": measure} if sequential else {}
                halves = asked(number=2, min_fidelity_all_at_end=95, max_tries=3, **words)
                if not sequential:
                    outcomes = [half.measure() for half in halves]
                unit.flush()
                return [int(outcomes[0]), int(outcomes[1])]

        return run

    programs = {"alice": program("alice", "bob", True), "bob": program("bob", "alice", False)}
    results = outputs(tmp_path, programs, TWO, rounds=4)
    assert [each["alice"] for each in results] == [each["bob"] for each in results]


def answer(folder: Path, *messages: bytes) -> str:
    """Say something to alice's unit; return why that is the end of it."""

    def speak() -> str:
        with socket.socket(socket.AF_UNIX) as unit:
            unit.settimeout(SOON_S)
            unit.connect(str(folder / "alice.sock"))
            unit.sendall(encode_fields(Call.PROCESS) + b"".join(messages))
            while True:
                header = unit.recv(HEADER.size, socket.MSG_WAITALL)
                call, length = decode_header(header)
                payload = unit.recv(length, socket.MSG_WAITALL) if length else b""
                if call == Call.FAILED:
                    return str(decode_fields(payload)["text"])

    async def run() -> str:
        async with network(folder):
            return await asyncio.to_thread(speak)

    return network_loop.run(run())


def test_hostile_bytes_are_refused_whole(tmp_path: Path) -> None:
    begun = encode(Call.DATA, bytes.fromhex("00000000 00000000 05000000"))
    assert "no message of NetQASM" in answer(tmp_path, encode(Call.DATA, b"\xff\xff"))
    bad = bytes(4) + bytes([1, 0, 0, 0, 0, 0, 0]) + bytes([99, 0, 0, 0, 0, 0, 0])
    assert "has number 99" in answer(tmp_path, begun, encode(Call.DATA, b"\2" + bad))
    lonely = bytes(4) + bytes([1, 0, 0, 0, 0, 0, 0])
    assert "register R0 is not defined" in answer(
        tmp_path, begun, encode(Call.DATA, b"\2" + lonely)
    )
    other = bytes(2) + b"\x09\0" + bytes([1, 0, 0, 0, 0, 0, 0])
    assert "application 9 has not begun" in answer(
        tmp_path, begun, encode(Call.DATA, b"\2" + other)
    )


def calls(text: bytes) -> Iterator[Call]:
    """Yield what each of the messages that a stack has sent is for."""
    while text:
        call, length = decode_header(text[: HEADER.size])
        yield call
        text = text[HEADER.size + length :]


def test_a_loop_without_end_keeps_nobody_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While one application turns in a circle for ever, another is served."""
    monkeypatch.setattr(machine, "MOST_EXECUTED", 10**12)
    begun = encode(Call.DATA, bytes.fromhex("00000000 00000000 05000000"))
    circle = encode(Call.DATA, b"\2" + bytes(4) + bytes([9, 0, 0, 0, 0, 0, 0]))

    def alice(app_config: Any = None) -> int:
        with socket.socket(socket.AF_UNIX) as unit:
            unit.connect(str(tmp_path / "alice.sock"))
            unit.sendall(encode_fields(Call.PROCESS) + begun + circle)
            with connection("alice", app_config) as own:
                qubit = Qubit(own)
                qubit.X()
                outcome = qubit.measure()
            unit.setblocking(False)
            text = unit.recv(1 << 16)
            # The hosts that are up, and the begin of an application; the circle still turns.
            assert [*calls(text)] == [Call.DONE, Call.DATA]
        return int(outcome)

    (report,) = outputs(tmp_path, {"alice": alice}, {"alice": "alice"})
    assert report["alice"] == 1


def test_the_sdks_own_application_for_one_node_runs(tmp_path: Path) -> None:
    results = outputs(tmp_path, EXAMPLES / "single_node", {"alice": "alice"})
    assert set(results[0]["alice"]) == {"m1", "m2"}
    assert json.dumps(results)
    assert threading.active_count() < 20
