"""Several sessions at once: beside each other where light fits, in turn where it does not."""

import threading
from pathlib import Path

import pytest
from conftest import wait_until
from fabric_scene import Session, facts, light_paths, running, session

from topologies.leaf_spine import LeafSpineTopo
from topologies.networks.network import Network

DATA = bytes(range(256)) * 64


class TwoTriplesTopo(LeafSpineTopo):
    """dave, erin and frank at the same leaves as alice, bob and charlie."""

    def build(self, leaves: int = 3, spines: int = 2, fibers: int = 2, **fiber: float) -> None:
        """Lay what both triples need."""
        super().build(leaves, spines, fibers, **fiber)
        for name, number, leaf, own in (
            ("dave", 5, "q1", 1),
            ("erin", 6, "q3", 2),
            ("frank", 7, "q2", 2),
        ):
            self.add_host(name, f"10.0.0.{number}", pairs_from="frank")
            self.join(name, leaf, own)


@pytest.mark.nightly
def test_two_sessions_share_the_switches_and_no_path(tmp_path: Path) -> None:
    with (
        running(TwoTriplesTopo, tmp_path) as network,
        session(network, "alice", "bob") as one,
        session(network, "dave", "erin") as other,
    ):
        assert len(light_paths("q1")) == 4
        outputs = light_paths("q3").values()
        assert len(set(outputs)) == len(outputs) == 4
        one.start(DATA)
        other.start(DATA[::-1])
        assert one.finish(len(DATA)) == DATA
        assert other.finish(len(DATA)) == DATA[::-1]


def test_a_queued_session_begins_when_the_first_has_ended(queueing_network: Network) -> None:
    network, before = queueing_network, len(facts(queueing_network, "queued"))
    first = Session(network, "alice", "bob", port=7).open()
    second = Session(network, "alice", "bob", port=8)
    opening = threading.Thread(target=second.open)
    opening.start()
    wait_until(lambda: len(facts(network, "queued")) > before, "the second waits")
    assert first.carry(DATA) == DATA
    first.close()
    opening.join(10)
    assert not opening.is_alive()
    assert second.carry(DATA) == DATA
    second.close()
