"""FILE.py:CLASS in place of a topology's name: what is taken, and what is refused by its name."""

import subprocess
from pathlib import Path

import pytest

from qmn.__main__ import described
from qmn.jobs.counted_service import checked
from qmn.network.custom_topology import BadTopology
from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from qmn.options import BadInput
from qmn.verbs.run import service_request
from wire.parameters.physics import Memory

ROOT = Path(__file__).resolve().parents[3]
MY_NET = f"{ROOT}/examples/my_net.py:MyNet"
PARTS = """
from topologies.nodes import QuantumHost
from topologies.quantum_topo import QuantumTopo
from wire.parameters.physics import Memory

class Parts(QuantumTopo):
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


@pytest.mark.parametrize(
    ("name", "options", "refusal"),
    [
        ("nowhere.py:MyNet", [], "there is no file .*nowhere.py; write FILE.py:CLASS"),
        ("parts.py:Nothing", [], "has no class Nothing of mininet.topo.Topo: choose one of Parts"),
        ("parts.py:Part", [], r"has no class Part of mininet.topo.Topo: did you mean Parts\?"),
        ("parts.py:NoTopo", [], "has no class NoTopo of mininet.topo.Topo"),
        ("broken.py:Broken", [], "broken.py cannot be loaded: No module named 'nowhere'"),
        ("parts.txt:Parts", [], "parts.txt is not a Python file"),
        ("parts.py:Parts", ["--preset", "metro"], "build of Parts takes no preset"),
        ("parts.py:Parts", ["--length-km", "3"], "build of Parts takes no length_km"),
        ("parts.py:Parts,map=garr", [], "build of Parts takes no map"),
        ("parts.py:Parts,switches=3", [], "build of Parts takes no switches"),
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


MAC = 'self.addHost("m%d", mac="%s")'
SLIPS = """
from mininet.topo import Topo
from topologies.links import FiberLink
from topologies.nodes import ClassicalSwitch, OpticalSwitch, QuantumHost

class Slip(Topo):
    def build(self, length_km=1.0):
        self.addHost("h1", cls=QuantumHost, ip="10.0.0.1/24")
        self.addSwitch("q1", cls=OpticalSwitch, dpid="1001")
        SLIP
"""


@pytest.mark.parametrize(
    ("slip", "refusal"),
    [
        (
            'self.addLink("h1", "q1", cls=FiberLink, lenght_km=2)',
            "fibre h1 to q1 has no lenght_km: did you mean length_km?",
        ),
        ('self.addLink("h1", "q1", lenght_km=2)', "copper h1 to q1 has no lenght_km: did you mean"),
        (
            'self.addHost("h2", cls=QuantumHost, sauce=True)',
            "h2 has no sauce: did you mean source?",
        ),
        (
            'self.addLink("h1", "q1", cls=FiberLink, loss_db_per_km=-1)',
            "fibre h1 to q1: loss_db_per_km -1: choose 0 to 1000",
        ),
        ('self.addLink("h1", "swx")', "there is no node 'swx' by then: add it with addHost or"),
        ('self.addSwitch("s", cls=ClassicalSwitch, dpid="zz")', "s: dpid 'zz' is not 1 to 16 hex"),
        ('self.addSwitch("s", cls=ClassicalSwitch, dpid=1)', "s: dpid 1 is not 1 to 16 hex"),
        (
            'self.addSwitch("s", cls=ClassicalSwitch)',
            's has no dpid: give one of its own, as dpid="1"',
        ),
        (
            'self.addHost("h1", cls=QuantumHost, ip="10.0.0.9/24")',
            "there is a node h1 already: give each a name of its own",
        ),
        ('self.addHost("q1", cls=QuantumHost)', "there is a node q1 already: give each a name"),
        (
            'self.addHost("h 1")',
            "'h 1' cannot be a node's name: begin with a letter of a",
        ),
        ('self.addHost("bücher", cls=QuantumHost)', "'bücher' cannot be a node's name: begin"),
        ('self.addSwitch("q1-eth1")', "'q1-eth1' cannot be a node's name: begin with a letter"),
        ('self.addHost("1h")', "'1h' cannot be a node's name: begin with a letter"),
        ('self.addHost("c0")', "'c0' cannot be a node's name: a program, file or interface of"),
        ('self.addHost("dispatcher", cls=QuantumHost)', "'dispatcher' cannot be a node's name: a"),
        ('self.addLink("h1", "h1")', "a link from h1 to h1 leads nowhere: join two different"),
        ('self.addLink("q1", "q1", cls=FiberLink)', "a link from q1 to q1 leads nowhere: join"),
        ("1 / 0", "ZeroDivisionError: division by zero; this shows all of it: PYTHONPATH="),
        ('int("zz")', "ValueError: invalid literal for int() with base 10: 'zz'; this shows"),
    ],
)
def test_a_slip_is_told_by_file_and_line(tmp_path: Path, slip: str, refusal: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(SLIPS.replace("SLIP", slip))
    with pytest.raises(BadTopology) as caught:
        describe_network(parse("--topology", f"{file}:Slip"))
    assert str(caught.value).startswith(f"{file}, line 10: {refusal}")
    assert "\n" not in str(caught.value)


def test_the_command_of_a_refusal_shows_the_whole_fault(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(SLIPS.replace("SLIP", "1 / 0"))
    with pytest.raises(BadTopology) as caught:
        describe_network(parse("--topology", f"{file}:Slip", "--length-km", "2"))
    command = str(caught.value).partition("shows all of it: ")[2]
    assert "length_km=2.0" in command
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.stderr.startswith("Traceback")
    assert f'File "{file}", line 10, in build' in done.stderr
    assert done.stderr.endswith("ZeroDivisionError: division by zero\n")


INHERITED = """
from functools import partialmethod
from topologies.sdc import SdcTopo

class Inherited(SdcTopo):
    def addSwitch(self, *_words, **_params):
        1 / 0

class Wrapped(Inherited):
    build = partialmethod(SdcTopo.build)
"""


@pytest.mark.parametrize("kind", ["Inherited", "Wrapped"])
def test_a_class_with_the_build_of_another_is_told_by_its_own_file(
    tmp_path: Path, kind: str
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(INHERITED)
    with pytest.raises(BadTopology) as caught:
        describe_network(parse("--topology", f"{file}:{kind}"))
    report, _, command = str(caught.value).partition("; this shows all of it: ")
    assert report == f"{file}, line 7: ZeroDivisionError: division by zero"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.stderr.endswith("ZeroDivisionError: division by zero\n")


def test_a_fault_in_loading_is_told_by_its_line(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("one = 1\n{}['two']\n")
    with pytest.raises(BadTopology, match=r"mine.py cannot be loaded: line 2: KeyError: 'two'; "):
        describe_network(parse("--topology", f"{tmp_path}/mine.py:Mine"))


def test_keywords_that_an_own_class_takes_apart_are_its_own(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    own = "class Own(QuantumHost):\n    def __init__(self, name, **params):\n"
    own += "        self.colour = params.pop('colour')\n        super().__init__(name, **params)\n"
    slip = 'self.addHost("h2", cls=Own, ip="10.0.0.2/24", colour="red")'
    text = SLIPS.replace("SLIP", slip).replace("class Slip", f"{own}\nclass Slip")
    quantum = "from topologies.quantum_topo import QuantumTopo as Topo"  # with s1 and ed
    file.write_text(text.replace("from mininet.topo import Topo", quantum))
    assert describe_network(parse("--topology", f"{file}:Slip")).hosts == ["h1", "h2"]


def test_what_is_of_all_fibres_can_be_said_of_some(tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(PARTS)
    with pytest.raises(BadTopology, match=r"single fibres \(--fiber A-B.length_km=VALUE\), "):
        describe_network(parse("--topology", f"{tmp_path}/parts.py:Parts", "--length-km", "3"))


@pytest.mark.parametrize(
    ("slip", "refusal"),
    [
        (
            'self.addHost("h2", cls=QuantumHost, ip="10.0.0.1/8")',
            "h1 and h2 have one address, 10.0.0.1: give each an ip",
        ),
        (
            'self.addSwitch("s", cls=ClassicalSwitch, dpid="00:10:01")',
            "q1 and s have one datapath ID, 1001: give each a dpid",
        ),
        (
            'self.addSwitch("s4097", cls=ClassicalSwitch)',  # 0x1001
            "q1 and s4097 have one datapath ID, 1001: give each a dpid",
        ),
        (
            'self.addHost("h2", cls=QuantumHost, ip="10.0.0.1")',
            "h1 and h2 have one address, 10.0.0.1: give each an ip",
        ),
        (
            'self.addLink(self.addHost("h2", ip="10.0.0.2/24"), "q1", cls=FiberLink)',
            "fibre h2 to q1: h2 has no light; make it of cls=QuantumHost",
        ),
        (
            f"{MAC % (1, 'aa:00:00:00:00:01')}; {MAC % (2, 'AA:00:00:00:00:01')}",
            "m1 and m2 have one MAC address, aa:00:00:00:00:01: give each a mac",
        ),
        (MAC % (1, "hello"), "m1: mac 'hello' is not that of one host: write six pairs of hex"),
        (MAC % (1, "01:00:5e:00:00:01"), "m1: mac '01:00:5e:00:00:01' is not that of one host"),
        (
            'self.addHost("h2", cls=QuantumHost, ip="10.0.0.300/24")',
            "h2: ip '10.0.0.300/24' is not an address: write ADDRESS/BITS",
        ),
        (
            'self.addLink(self.addHost("abcdefghijk", cls=QuantumHost, ip="10.0.0.2/24"), "q1")',
            "abcdefghijk: its interface abcdefghijk-eth0 would have 16 letters, and Linux "
            "takes 15: choose a name of at most 10",
        ),
    ],
)
def test_clashes_are_told_by_name(tmp_path: Path, slip: str, refusal: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(SLIPS.replace("SLIP", slip))
    with pytest.raises(BadTopology) as caught:
        describe_network(parse("--topology", f"{file}:Slip"))
    assert refusal in str(caught.value)


def test_a_host_without_light_is_told_to_be_one() -> None:
    words = ("--topology", MY_NET, "--from", "h1", "--to", "ed")
    whole = ["run", "teleport", *words]
    with pytest.raises(BadInput, match=r"host 'ed' has no light.*cls=QuantumHost.*of h1, h2, src"):
        checked(service_request(described(whole).parse_args(whole)))


def test_a_name_that_is_neither_is_refused_with_those_there_are(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        parse("--topology", "star")
    assert "'star': choose one of sdc, chain, ring" in capsys.readouterr().err
