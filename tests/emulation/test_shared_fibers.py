"""Sessions that share a fibre by wavelength, over real switches."""

from functools import partial
from pathlib import Path

import pytest
from conftest import wait_until
from fabric_scene import facts, light_paths, running, session

from hosts.quantum_socket import QuantumSocketError
from topologies.links.fiber import PORTS_PER_CHANNEL
from topologies.sdc import SdcTopo
from wire.config import Fiber, FiberEnd
from wire.metadata.vocabulary import Reason

DATA = bytes(range(256)) * 16


def ends(fiber: Fiber) -> list[FiberEnd]:
    """Return the end at q1 of alice's fibre, by its first channel."""
    mine = fiber.a.node == "alice" and fiber.channel == 1
    return [fiber.b] if mine else []


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("framework", ["ryu", "os-ken"])
def test_both_hosts_send_and_receive_at_once_each_way_in_a_channel(
    tmp_path: Path, framework: str
) -> None:
    topo = partial(SdcTopo, both_ways=True, channels=2)
    with running(topo, tmp_path, controller=framework) as network:
        assert len(facts(network, "fiber")) == 12  # six fibres, each of two channels
        with (
            session(network, "alice", "bob", port=7) as there,
            session(network, "bob", "alice", port=8) as back,
        ):
            paths = light_paths("q1")
            assert len(paths) == 6
            # Light keeps its channel.
            channels = [(i // PORTS_PER_CHANNEL, o // PORTS_PER_CHANNEL) for i, o in paths.items()]
            assert sorted(channels) == [(0, 0)] * 3 + [(1, 1)] * 3
            with pytest.raises(QuantumSocketError) as caught, session(network, "alice", "bob", 9):
                pass
            assert caught.value.reason == Reason.BUSY
            there.start(DATA)
            back.start(DATA[::-1])
            assert there.finish(len(DATA)) == DATA
            assert back.finish(len(DATA)) == DATA[::-1]


def test_a_cut_fibre_is_cut_in_all_its_channels(tmp_path: Path) -> None:
    with running(partial(SdcTopo, channels=3), tmp_path) as network:
        (first,) = {end.port for fiber in network.runtime.fibers for end in ends(fiber)}
        expected = {int(first) + PORTS_PER_CHANNEL * channel for channel in range(3)}
        network.net.configLinkStatus("alice", "q1", "down")

        def downs() -> set[object]:
            return {fact["at"] for fact in facts(network, "port") if not fact["up"]}

        wait_until(lambda: downs() == expected, "all channels of the fibre are down")
