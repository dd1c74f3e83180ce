"""Light over several quantum switches: found, set up whole, moved when a fibre is cut."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import ClassVar

import grpc
import pytest
from conftest import wait_until
from fabric_scene import (
    Session,
    TurningRingTopo,
    facts,
    light_paths,
    running,
    session,
    switches_on_the_way,
)
from loaded import forks
from mininet.topo import Topo

from hosts.quantum_socket import QuantumSocketError
from topologies.chain import ChainTopo
from topologies.leaf_spine import LeafSpineTopo
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import python
from wire.dispatcher_pb2 import TunePortRequest
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import metadata
from wire.metadata.vocabulary import Reason

DATA = bytes(range(256)) * 64


class UnevenRingTopo(TurningRingTopo):
    """One whose ways differ."""

    ROTATIONS: ClassVar = {"q1": 1, "q2": 2, "q3": 2, "q4": 3}


@pytest.mark.by_day(every=4)  # Ryu has chains and rings that stand
@pytest.mark.parametrize("framework", ["os-ken", "ryu"])
@pytest.mark.parametrize(
    ("topo", "links", "way"),
    [
        (partial(LeafSpineTopo, leaves=3, spines=2), 6, ["q1", "q4", "q3", "bob"]),
        (partial(ChainTopo, switches=3), 4, ["q1", "q2", "q3", "bob"]),
    ],
)
def test_bytes_cross_several_switches(
    tmp_path: Path, topo: Callable[[], Topo], links: int, way: list[str], framework: str
) -> None:
    with running(topo, tmp_path, controller=framework) as network:
        assert len(facts(network, "link")) == links
        with session(network, "alice", "bob") as opened:
            # The set-up is answered: every switch on the way is ready.
            assert switches_on_the_way(network, "alice-q0") == way
            assert switches_on_the_way(network, "charlie-q0")[-1] == "alice"
            assert switches_on_the_way(network, "charlie-q1")[-1] == "bob"
            assert opened.carry(DATA) == DATA
        wait_until(lambda: not any(map(light_paths, way[:-1])), "the paths are closed")


@contextmanager
def mended(network: Network, one: str, other: str) -> Iterator[None]:
    """Leave the fibres between two switches whole."""
    try:
        yield
    finally:
        network.net.configLinkStatus(one, other, "up")


def test_a_session_goes_the_other_way_round_when_its_fibre_is_cut(ring_network: Network) -> None:
    network, data = ring_network, DATA * 64
    with (
        mended(network, "q1", "q2"),
        session(network, "alice", "bob") as opened,
    ):
        moved, stranded = (len(facts(network, each)) for each in ("moved", "stranded"))
        before = switches_on_the_way(network, "alice-q0")
        opened.start(data)
        log = network.runtime.logs / "quantum.log"
        wait_until(lambda: " bell-measure " in log.read_text(), "light has arrived")
        network.net.configLinkStatus(before[0], before[1], "down")  # both fibres
        wait_until(lambda: len(facts(network, "moved")) > moved, "the session is moved")
        assert opened.finish(len(data)) == data
        after = switches_on_the_way(network, "alice-q0")
        assert (before, after) == (["q1", "q2", "q3", "bob"], ["q1", "q4", "q3", "bob"])
        assert len(facts(network, "stranded")) == stranded


def test_light_is_not_moved_to_where_it_is_turned_differently(tmp_path: Path) -> None:
    data = DATA * 16
    with (
        running(UnevenRingTopo, tmp_path) as network,
        session(network, "alice", "bob") as opened,
    ):
        way = switches_on_the_way(network, "alice-q0")
        opened.start(data)
        network.net.configLinkStatus(way[0], way[1], "down")
        wait_until(lambda: facts(network, "stranded"), "there is no other way")
        assert switches_on_the_way(network, "alice-q0") == way
        network.net.configLinkStatus(way[0], way[1], "up")
        assert opened.finish(len(data)) == data
        assert switches_on_the_way(network, "alice-q0") == way


def test_the_session_after_a_cut_or_mended_fibre_finds_it_so(chain_network: Network) -> None:
    network = chain_network
    with mended(network, "q1", "q2"):
        for _ in range(3):
            network.net.configLinkStatus("q1", "q2", "down")
            refused = Session(network, "alice", "bob")
            with pytest.raises(QuantumSocketError, match="fibre q1-q2"):
                refused.open()
            refused.close()
            network.net.configLinkStatus("q1", "q2", "up")
            with session(network, "alice", "bob") as opened:
                assert opened.carry(b"hello") == b"hello"


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("framework", ["ryu", "os-ken"])
def test_a_session_outlives_the_agent_of_its_switch(tmp_path: Path, framework: str) -> None:
    with (
        running(SdcTopo, tmp_path, controller=framework) as network,
        session(network, "alice", "bob") as opened,
    ):
        agent = network.net.get("q1").program
        before = light_paths("q1")
        agent.stop()
        config = network.runtime.folder / "q1-agent.json"
        command = [python(), "-m", "qswitch_agent", "--config", str(config)]
        agent.start(command, forks=forks())
        wait_until(lambda: len(facts(network, "switch")) == 3, "q1 is here again")
        assert light_paths("q1") == before
        assert opened.carry(DATA) == DATA
        assert facts(network, "torn_down") == []


@pytest.mark.nightly
@pytest.mark.parametrize(("budget_db", "fits"), [(20.1, True), (19.9, False)])
def test_the_loss_of_a_path_is_measured_and_kept_within_the_budget(
    tmp_path: Path, budget_db: float, fits: bool
) -> None:
    topo = partial(ChainTopo, switches=3, length_km=10.0, loss_db_per_km=0.5)
    with running(topo, tmp_path, loss_budget_db=budget_db) as network:
        asked = Session(network, "alice", "bob")
        if fits:  # four fibres of 5 dB
            asked.open()
        else:
            with pytest.raises(QuantumSocketError, match="loss budget") as caught:
                asked.open()
            assert caught.value.reason == Reason.LOSS_TOO_HIGH
        asked.close()


def test_a_port_of_another_wavelength_is_tuned_before_light_comes(
    shared_network: Network,
) -> None:
    tune(shared_network, "q1", "alice-q0", 194_000_000)
    wait_until(lambda: tuned(shared_network)[-1] == 194_000_000, "the controller knows")
    with session(shared_network, "alice", "bob") as opened:
        assert opened.carry(DATA) == DATA


def tune(network: Network, switch: str, interface: str, frequency_mhz: int) -> None:
    """Tune a port of a switch behind the controller's back."""
    runtime = network.runtime
    (port,) = (int(fiber.b.port) for fiber in runtime.fibers if fiber.a.port == interface)
    with grpc.insecure_channel(f"unix:{runtime.socket('dispatcher')}") as channel:
        DispatcherStub(channel).TunePort(  # type: ignore[no-untyped-call]
            TunePortRequest(switch=switch, port=port, frequency_mhz=frequency_mhz),
            metadata=metadata(runtime.token(switch)),
            timeout=10,
        )


def tuned(network: Network) -> list[object]:
    """Return the frequencies that the controller has learned, in order."""
    return [fact["mhz"] for fact in facts(network, "tuned")]
