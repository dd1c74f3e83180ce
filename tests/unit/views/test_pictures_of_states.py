"""The pictures of teleported states and of chains, and the sentence of a run."""

import re

import pytest
from scipy.stats import binomtest

from views.report.bloch_diagram import bloch_diagram, lengths
from views.report.chain_diagram import chain_diagram, chain_of
from views.report.programs import instruction_table, instructions
from wire.dispatcher_pb2 import BlockId, Event


def test_what_is_left_of_a_state_is_that_of_its_fidelity() -> None:
    """Nielsen and Chuang, 2.5: along its own direction a state of fidelity F has 2F - 1."""
    length, low, high = lengths(arrived=1000, agreed=828)
    bounds = binomtest(828, 1000).proportion_ci(method="wilson")
    assert length == pytest.approx(2 * 0.828 - 1)
    assert (low, high) == pytest.approx((2 * bounds.low - 1, 2 * bounds.high - 1))


def test_only_states_that_arrived_are_drawn() -> None:
    drawn = bloch_diagram([[100, 100], [0, 0], [100, 75], [0, 0], [100, 50], [0, 0]])
    texts = re.findall(r">(\|[^<]*)</text>", drawn)
    assert texts == ["|0⟩ 1.000", "|+⟩ 0.500", "|+i⟩ 0.000"]


def stored(session: int, number: int, half: int, node: str, kind: str, detail: str = "") -> Event:
    block = BlockId(session=session, number=number, half=half)
    return Event(node=node, kind=kind, block=block, detail=detail)


def test_a_chain_is_that_of_its_links_with_the_oldest_age_at_each_node() -> None:
    """Both ends' own blocks are of one session, with numbers in turn; each source has its own."""
    links = {
        (1, 2): ("alice", "q1-memory1"),
        (1, 3): ("bob", "q2-memory2"),
        (2, 1): ("q1-memory2", "q2-memory1"),
    }
    events = [
        stored(*block, half, node, "store")
        for block, ends in links.items()
        for half, node in enumerate(ends)
    ]
    detail = "after 0.000392157 to 0.000791315 s Z=1"
    events.append(stored(1, 2, 1, "q1-memory1", "recall", detail))
    events.append(stored(2, 1, 0, "q1-memory2", "recall", "after 0.0002 s"))
    nodes, ages = chain_of(events, "alice")
    assert nodes == ["alice", "q1", "q2", "bob"]
    assert ages == {("q1", 1): 0.000791315, ("q1", 2): 0.0002}
    words = re.findall(r">([^<>]+)</text>", chain_diagram(nodes, ages))
    assert words == ["alice", "q1", "0.791 ms", "q2", "bob"]


def test_the_table_has_instructions_of_qubits_in_the_column_of_their_host() -> None:
    text = "set R0 10; array R0 0; create_epr R1 R2 R3 R4 R5; wait_all 0 R5 R6; cnot Q0 Q1; h Q0"
    assert instructions(text) == [
        "create_epr R1 R2 R3 R4 R5",
        "wait_all 0 R5 R6",
        "cnot Q0 Q1",
        "h Q0",
    ]
    events = [
        Event(node="alice", kind="subroutine", time_ns=1000, detail=text),
        Event(node="bob", kind="subroutine", time_ns=4500, detail="set Q0 0; <b> Q0"),
    ]
    made = instruction_table(events, {"sender": "alice", "receiver": "bob"})
    assert "<th>alice</th><th>bob</th>" in made
    assert "<td>3.500</td><td></td><td>&lt;b&gt; Q0</td>" in made
    assert "array" not in made
