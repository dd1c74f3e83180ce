"""Programs in the manner of SimulaQron's and SquidASM's, with nothing but NetQASM's SDK."""

import select
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from limits import SOON_S
from netqasm.sdk import EPRSocket
from netqasm_scene import outputs
from test_bundled_applications import ANGLES, fidelity, qubit

from applications.netqasm.connection import Connection

STYLES = Path(__file__).parent / "netqasm_styles"


def test_a_program_in_simulaqrons_manner_makes_the_same_bits_at_both_ends(tmp_path: Path) -> None:
    hosts, bits = {"Alice": "alice", "Bob": "bob"}, 12
    inputs = [{role: {"bits": bits} for role in hosts}]
    (report,) = outputs(tmp_path, STYLES / "simulaqron", hosts, inputs)
    assert report["Alice"] == report["Bob"]
    assert len(report["Alice"]) == bits
    assert set(report["Alice"]) == {0, 1}  # of 12 equal bits this once fails in 2,048 seeds


def test_a_program_in_squidasms_manner_teleports_and_loops(tmp_path: Path) -> None:
    hosts = {"sender": "alice", "receiver": "bob"}
    phi, theta, pairs = 0.7, 1.1, 6
    inputs: list[dict[str, dict[str, Any]]] = [
        {"sender": {"phi": phi, "theta": theta, "pairs": pairs}, "receiver": {"pairs": pairs}}
    ]
    (report,) = outputs(tmp_path, STYLES / "squidasm", hosts, inputs, state_inspection=True)
    state = np.array(report["receiver"]["state"])
    assert abs(fidelity(state, qubit(phi, theta)) - 1) < ANGLES**2
    assert report["sender"] == report["receiver"]["outcomes"]  # of Phi+, along X
    assert len(report["sender"]) == pairs


def test_a_broadcast_is_heard_after_another_program_has_ended(tmp_path: Path) -> None:
    def joined(role: str) -> Any:
        from netqasm.sdk.external import BroadcastChannel

        return BroadcastChannel(role, [other for other in "abc" if other != role])

    def ends_at_once(app_config: Any) -> None:
        joined("a").send("first")

    def waits(app_config: Any) -> str:
        channel = joined("b")
        texts = [channel.recv()[1]]
        texts.append(channel.recv()[1])
        channel.send("last")
        return ",".join(sorted(texts))

    def hears(app_config: Any) -> list[str]:
        channel = joined("c")
        report = list(channel.recv())
        select.select([channel._sockets["a"]], [], [])  # it has ended
        channel.send("go on")
        return [*report, *channel.recv()]

    programs = {"a": ends_at_once, "b": waits, "c": hears}
    (report,) = outputs(tmp_path, programs, {"a": "alice", "b": "bob", "c": "charlie"})
    assert report["b"] == "first,go on"
    assert report["c"] == ["a", "first", "b", "last"]


def test_who_looks_sees_what_was_asked_for_before(tmp_path: Path) -> None:
    """As a program does that does not flush its corrections."""

    def flips(app_config: Any) -> Any:
        from netqasm.sdk import Qubit
        from netqasm.sdk.external import NetQASMConnection, get_qubit_state

        with NetQASMConnection("a") as connection:
            qubit = Qubit(connection)
            connection.flush()
            qubit.X()
            return get_qubit_state(qubit)

    (report,) = outputs(tmp_path, {"a": flips}, {"a": "alice"}, state_inspection=True)
    assert np.allclose(report["a"], [[0, 0], [0, 1]])


def test_qubits_stay_until_the_programs_of_all_roles_have_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one who still runs looks at Phi+, whose other half an ended program has left."""
    closed, close = threading.Event(), Connection.close

    def note(connection: Connection, *arguments: Any, **words: Any) -> None:
        close(connection, *arguments, **words)
        if connection.app_name == "b":
            closed.set()

    monkeypatch.setattr(Connection, "close", note)

    def leaves(app_config: Any) -> None:
        from netqasm.sdk.external import NetQASMConnection

        pairs = EPRSocket("a")
        with NetQASMConnection("b", epr_sockets=[pairs]):
            pairs.recv_keep()

    def looks(app_config: Any) -> Any:
        from netqasm.sdk.external import NetQASMConnection, get_qubit_state

        pairs = EPRSocket("b")
        with NetQASMConnection("a", epr_sockets=[pairs]) as unit:
            (half,) = pairs.create_keep()
            unit.flush()
            assert closed.wait(SOON_S)
            closed.clear()
            return get_qubit_state(half, reduced_dm=False)

    programs = {"a": looks, "b": leaves, "c": lambda app_config: None}
    hosts = {"a": "alice", "b": "bob", "c": "charlie"}
    results = outputs(tmp_path, programs, hosts, rounds=3, state_inspection=True)
    phi_plus = np.outer([1, 0, 0, 1], [1, 0, 0, 1]) / 2
    for each in results:
        assert np.allclose(each["a"], phi_plus)
