"""Optics of a single fibre, switch or host of any network, from the command line and scripts."""

from pathlib import Path
from typing import Any

import pytest
from mininet.topo import Topo

from qmn.__main__ import described
from qmn.network.custom_topology import BadTopology
from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from qmn.options import BadInput, read
from qmn.scripting import start
from topologies.links.copper_link import CopperLink
from topologies.links.fiber import FiberLink
from topologies.sdc import SdcTopo
from wire.parameters.physics import Memory

MY_NET = f"{Path(__file__).resolve().parents[3]}/examples/my_net.py:MyNet"
WITH_MEMORY = """
from topologies.nodes import QuantumHost
from topologies.quantum_topo import QuantumTopo
from wire.parameters.physics import Memory, PairSource

class WithMemory(QuantumTopo):
    def build(self):
        source = PairSource(fidelity=0.9)
        self.addHost("h1", cls=QuantumHost, ip="10.0.0.1/24", memory=Memory(t2_s=0.5))
        self.addHost("h2", cls=QuantumHost, ip="10.0.0.2/24", source=source)
"""


def parse(*words: str) -> NetworkOptions:
    """Return what the command line says of the network."""
    whole = ["run", *words]
    return read(NetworkOptions, described(whole).parse_args(whole))


def own(*words: str) -> Topo:
    """Return the network of the example with options."""
    return describe_network(parse("teleport", "--topology", MY_NET, *words)).topo


def of_links(topo: Topo, kind: type, name: str) -> dict[str, list[Any]]:
    """Return a keyword of all links of a kind."""
    found: dict[str, list[Any]] = {}
    for one, other, info in topo.links(withInfo=True):
        if info.get("cls") is kind:
            found.setdefault(f"{one}-{other}", []).append(info.get(name))
    return found


@pytest.mark.parametrize("place", ["q1-q2", "q2-q1"])
def test_the_fibres_between_two_nodes_are_as_long_as_is_said_and_no_others(place: str) -> None:
    lengths = of_links(own("--fiber", f"{place}.length_km=40"), FiberLink, "length_km")
    assert lengths == {
        "h1-q1": [None],
        "h2-q2": [None] * 2,
        "src-q2": [None] * 2,
        "q1-q2": [40.0] * 2,
    }


def test_a_kind_of_one_fibre_brings_its_loss_along() -> None:
    losses = of_links(own("--fiber", "q1-q2.kind=pm"), FiberLink, "loss_db_per_km")
    assert losses["q1-q2"] == [0.5, 0.5]  # Fujikura's SM15-PS


def test_copper_is_as_long_as_the_fibres_that_were_changed() -> None:
    """h1 -- q1 == q2 -- h2: s1 is where the farthest is nearest, at q1 or q2."""
    topo = describe_network(
        parse("sdc", "--topology", "chain,2", "--fiber", "q1-q2.length_km=40")
    ).topo
    copper = of_links(topo, CopperLink, "length_km")
    assert copper["alice-s1"][0] + copper["bob-s1"][0] == pytest.approx(40.02)


def test_optics_are_of_one_switch_or_of_all() -> None:
    topo = own("--switch", "insertion_loss_db=1.2", "--switch", "q2.crosstalk_db=30")
    assert [topo.nodeInfo(name).get("insertion_loss_db") for name in ("q1", "q2")] == [1.2, 1.2]
    assert [topo.nodeInfo(name).get("crosstalk_db") for name in ("q1", "q2")] == [None, 30.0]
    assert "insertion_loss_db" not in topo.nodeInfo("s1")


def test_a_device_is_the_host_s_own_but_for_what_is_said(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(WITH_MEMORY)
    words = ["teleport", "--topology", f"{tmp_path}/own.py:WithMemory"]
    words += ["--device", "h1.detectors.efficiency=0.8", "--device", "h2.memory.capacity=9"]
    network = describe_network(parse(*words))
    devices = network.parts.hosts
    assert devices["h1"].memory == Memory(t2_s=0.5)
    assert devices["h1"].detectors.efficiency == 0.8
    assert (devices["h2"].memory.capacity, devices["h2"].source.fidelity) == (9, 0.9)
    assert network.parts.sources == ("h2",)
    assert network.stated_devices == devices


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ["--fiber", "q1-q9.length_km=4"],
            "no fibre q1-q9: choose one of h1-q1, h2-q2, q1-q2, q2-",
        ),
        (
            ["--fiber", "q1-q2.colour=4"],
            "--fiber q1-q2.colour=4: a fibre has no colour: choose one of kind, length_km",
        ),
        (["--fiber", "q1-q2.length_km=-4"], "fibre q1-q2: length_km -4.0: choose 0 to 2000"),
        (["--switch", "q9.insertion_loss_db=1"], "no quantum switch q9: choose one of q1, q2"),
        (["--switch", "s1.insertion_loss_db=1"], "no quantum switch s1: choose one of q1, q2"),
        (
            ["--switch", "q1.gain_db=1"],
            "a quantum switch has no gain_db: choose one of switching_time_s, insertion_loss_db",
        ),
        (["--switch", "q1.insertion_loss_db=-1"], "q1: insertion_loss_db -1.0: choose 0 to 100"),
        (
            ["--switch", "q1.rotation=half"],
            "--switch q1.rotation=half: 'half': choose a whole number",
        ),
        (["--device", "h9.memory.capacity=1"], "--device h9: choose one of h1, h2, src"),
        (["--node", "h9=ion-trap"], "--device h9: choose one of h1, h2, src"),
    ],
)
def test_a_part_or_parameter_that_is_not_there_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadTopology, match=text):
        own(*words)


def test_scripts_say_the_same_of_a_network_of_their_own() -> None:
    with pytest.raises(BadTopology, match="no fibre alice-q9: choose one of alice-q1"):
        start(SdcTopo, fiber=["alice-q9.length_km=3"]).__enter__()
    with pytest.raises(BadInput, match="length_km=3 is of the topologies of qmn: say of which"):
        start(SdcTopo, fiber=["length_km=3"]).__enter__()
    with pytest.raises(BadTopology, match="there is no file nowhere"):
        start("nowhere.py:Net").__enter__()


def test_a_pattern_sets_the_devices_of_all_hosts_that_it_names() -> None:
    words = ["ghz", "--topology", "repeaters,2", "--device", "*.memory.t2_s=100ms"]
    network = describe_network(parse(*words, "--device", "r?.gates.readout_error=0.01"))
    times = {host: device.memory.t2_s for host, device in network.parts.hosts.items()}
    assert times == dict.fromkeys(("alice", "r1", "r2", "bob"), 0.1)
    errors = {host: device.gates.readout_error for host, device in network.parts.hosts.items()}
    assert errors == {"alice": 0, "r1": 0.01, "r2": 0.01, "bob": 0}


@pytest.mark.parametrize(
    ("word", "why"),
    [
        ("z*.memory.t2_s=1", r"no host is z\*, of alice, bob, charlie"),
        ("*.memory.t9_s=1", "memory has no t9_s: did you mean"),
        ("*.memory.t2_s=5km", "'5km': choose a number of s, as 5 or 5s"),
        ("*=1", "write HOST.PART.NAME=VALUE"),
    ],
)
def test_a_pattern_of_nothing_is_refused(word: str, why: str) -> None:
    with pytest.raises(BadTopology, match=why):
        describe_network(parse("teleport", "--device", word))
