"""FILE.py:CLASS in place of a topology's name: what is taken, and what is refused by its name."""

from pathlib import Path

import pytest

from qmn.__main__ import described
from qmn.network.custom_topology import BadTopology
from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from qmn.network.time_scale import times
from qmn.verbs.run import service_request
from wire.parameters.physics import Memory

ROOT = Path(__file__).resolve().parents[3]
MY_NET = f"{ROOT}/examples/my_net.py:MyNet"
PARTS = """
from mininet.topo import Topo
from topologies.nodes import QuantumHost
from wire.parameters.physics import Memory

class Parts(Topo):
    def build(self):
        self.addHost("h1", cls=QuantumHost, ip="10.0.0.1/24", memory=Memory(t2_s=0.5))
        self.addHost("plain", ip="10.0.0.2/24")

class NoTopo:
    pass
"""


def parse(*words: str) -> NetworkOptions:
    """Return what the command line says of the network."""
    whole = ["run", "teleport", *words]
    return service_request(described(whole).parse_args(whole)).network


def test_the_example_is_built_and_told_how_long_its_fibres_are() -> None:
    network = describe_network(parse("--topology", MY_NET, "--length-km", "7"))
    assert network.hosts == ["h1", "h2", "src"]
    lengths = {(fiber.a, fiber.b): fiber.optics.length_km for fiber in network.parts.fibers}
    assert lengths["q1", "q2"] == 7
    assert set(lengths) == {("h1", "q1"), ("h2", "q2"), ("src", "q2"), ("q1", "q2")}


def test_parts_of_a_device_are_seen_where_devices_are_asked_for(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS)
    network = describe_network(parse("--topology", f"{tmp_path}/parts.py:Parts"))
    assert network.hosts == ["h1"]
    assert network.parts.hosts["h1"].memory == Memory(t2_s=0.5)
    assert ("T2 of h1", 0.5) in list(times(network.parts))


@pytest.mark.parametrize(
    ("name", "options", "refusal"),
    [
        ("nowhere.py:MyNet", [], "there is no file .*nowhere.py; write FILE.py:CLASS"),
        ("parts.py:Nothing", [], "has no class Nothing of mininet.topo.Topo"),
        ("parts.py:NoTopo", [], "has no class NoTopo of mininet.topo.Topo"),
        ("broken.py:Broken", [], "broken.py cannot be loaded: No module named 'nowhere'"),
        ("parts.txt:Parts", [], "parts.txt is not a Python file"),
        ("parts.py:Parts", ["--preset", "metro"], "--preset: build of Parts takes no preset"),
        ("parts.py:Parts", ["--length-km", "3"], "--length-km: build of Parts takes no length_km"),
        ("parts.py:Parts", ["--switches", "3"], "--switches: build of Parts takes no switches"),
    ],
)
def test_what_there_is_not_is_refused(
    tmp_path: Path, name: str, options: list[str], refusal: str
) -> None:
    for file in ("parts.py", "parts.txt"):
        (tmp_path / file).write_text(PARTS)
    (tmp_path / "broken.py").write_text("import nowhere\n")
    with pytest.raises(BadTopology, match=refusal):
        describe_network(parse("--topology", f"{tmp_path}/{name}", *options))


def test_a_name_that_is_neither_is_refused_with_those_there_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        parse("--topology", "star")
    assert "'star': choose sdc, chain, ring" in capsys.readouterr().err
