"""Swaps by the Bell analyser of a switch, programmed by Ryu's stock ofctl_rest and curl alone."""

import json
import re
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from math import exp, sqrt
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
import pytest
from agent_scene import Operator
from conftest import ROOT, nothing_left, wait_until
from fabric_scene import Line, restarted_agent, running, served
from limits import SOON_S
from loaded import run_qmn

from hosts.stack_socket import QuantumSocketError
from qmn.changes.fault import Failed, Repair, inject
from qmn.running.dispatcher_calls import status
from qmn.running.network import dispatcher_of_running_network
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.runs.runtime import free_port
from wire.parameters.physics import BellAnalyser, Device, Gates, Memory, PairSource

Q1 = 0x1001
ALICE, BOB, COPPER, FIRST, SECOND = 2, 3, 1, 60_001, 60_002  # ports of q1
MEMORIES = 61_001, 61_002
CAPACITY = 5000
T2_S = 1e-3
FRAMES = 0x88B5  # EtherType
BLOCK, LOSS_DB_PER_KM = 4000, 0.2
QUISP = json.loads((ROOT / "labs" / "quisp" / "figures.json").read_text())
NOISY_SWAP = "swap-F-0.9-gate-0.96-readout-0.98"
FIDELITY = 0.92  # of each source, of Werner pairs
VISIBILITY = 0.9
# Of blocks that wait in vain, or whose heralds or outcomes no agent was there to send.
UNHEARD = "released it from the memory|no outcomes of|frames of others were lost"


class SwapTopo(SdcTopo):
    """alice and bob make pairs, and q1 has an analyser, and two memories if these have a T2."""

    def build(
        self, fidelity: float = 1.0, visibility: float = 1.0, t2_s: float = 0.0, **fiber: Any
    ) -> None:
        """Lay the network with sources and an analyser that are so good."""
        super().build(**fiber)
        source = Device(source=PairSource(fidelity=fidelity))
        for host in ("alice", "bob"):
            self.setNodeInfo(host, {**self.nodeInfo(host), "device": source})
        analyser = BellAnalyser(visibility=visibility)
        parts = {"analysers": 1, "analyser": analyser}
        if t2_s:
            parts |= {"memories": 2, "memory": Memory(t2_s=t2_s, capacity=CAPACITY)}
        self.setNodeInfo("q1", {**self.nodeInfo("q1"), **parts})


class Curl:
    """curl, asking the controller's ofctl_rest."""

    def __init__(self, address: str) -> None:
        self._address = address

    def __call__(self, path: str, content: dict[str, Any] | None = None) -> Any:
        words = ["curl", "-sS", "--fail-with-body", f"http://{self._address}/stats/{path}"]
        words += ["-d", json.dumps({"dpid": Q1, **content})] if content is not None else []
        done = subprocess.run(words, capture_output=True, timeout=SOON_S, check=True)
        return json.loads(done.stdout)[str(Q1)] if done.stdout else None

    def add(self, in_port: int, *actions: dict[str, Any], **more: Any) -> None:
        """Add an entry."""
        entry = {"match": {"in_port": in_port}, **more}
        entry["instructions"] = [{"type": "APPLY_ACTIONS", "actions": actions}]
        self("flowentry/add", entry)


def output(port: int | str) -> dict[str, Any]:
    return {"type": "OUTPUT", "port": port}


def to_host(network: Network, host: str) -> list[dict[str, Any]]:
    """Return the actions that send a frame to one host."""
    mac = network.net.get(host).defaultIntf().MAC()
    return [{"type": "SET_FIELD", "field": "eth_dst", "value": mac}, output(COPPER)]


def documented(words: str, address: str = "") -> list[str]:
    """Return the lines of the block of docs/switch-swaps.md with such words in it."""
    page = (ROOT / "docs" / "switch-swaps.md").read_text()
    (lines,) = [block for block in page.split("```")[1::2] if words in block]
    return lines.replace("127.0.0.1:8080", address).splitlines()


def shell(lines: list[str]) -> None:
    text = "\n".join(lines)
    subprocess.run(["bash", "-ec", text], capture_output=True, timeout=SOON_S, check=True)


@contextmanager
def swapping(
    folder: Path, words: str = "curl -s $add", **noise: float
) -> Iterator[tuple[Network, Curl]]:
    """Run the network; q1 has the entries of a swap, by that block of the documentation."""
    address = f"127.0.0.1:{free_port()}"
    with (
        nothing_left(),
        running(
            lambda: SwapTopo(**noise), folder, rest=address, apps=["ryu.app.ofctl_rest"]
        ) as network,
    ):
        shell(documented(words, address))
        yield network, Curl(address)


def swapped(network: Network, **options: Any) -> dict[str, Any]:
    """Let alice and bob swap by way of q1."""
    return served(network, "swap", "alice", "bob", **{"block_pairs": 4000, **options})


def require_nothing_left(network: Network) -> None:
    """Fail unless all qubits are gone, also by the statistics of memories."""
    wait_until(lambda: not status(network).live_qubits, "no qubit is left")
    for name, optics in network.runtime.switches.items():
        if optics.memories:
            with Operator(name) as operator:
                assert {each.held for each in operator.memories()} == {0}


@contextmanager
def packets_in() -> Iterator[Callable[[], str]]:
    """Be one more controller of q1, by ovs-ofctl; give what it has heard."""
    words = ["ovs-ofctl", "-O", "OpenFlow14", "monitor", "q1", "128", "watch:"]
    with (
        TemporaryFile("w+") as heard,
        subprocess.Popen(words, stdout=heard, stderr=subprocess.STDOUT) as monitor,
    ):

        def text() -> str:
            heard.seek(0)
            return heard.read()

        try:
            wait_until(text, "it has figures of the entries that there are")
            yield text
        finally:
            monitor.terminate()


def test_curl_alone_swaps_and_each_end_of_light_has_a_name(tmp_path: Path) -> None:
    with swapping(tmp_path) as (network, curl):
        require_swap(network, curl)
        require_named_ends(network, curl)


def require_swap(network: Network, curl: Curl) -> None:
    """Fail unless a session has ideal pairs, and its outcomes come by each way."""
    ports = {port["port_no"]: port for port in curl(f"portdesc/{Q1}")}
    assert (ports[FIRST]["name"], ports[SECOND]["name"]) == ("q1-bell1a", "q1-bell1b")
    with packets_in() as heard:
        figures = swapped(network, count=5000, sample=0.2)
        assert (figures["pairs"], figures["fidelity"]) == (5000, 1)
        text = f"in_port={FIRST} (via "
        wait_until(lambda: text in heard(), "outcomes are a PACKET_IN", 10)
    counted = {curl(f"port/{Q1}/{port}")[0]["tx_packets"] for port in (FIRST, SECOND)}
    assert counted == {figures["emitted"]}
    (entry,) = [flow for flow in curl(f"flow/{Q1}") if flow["match"] == {"in_port": FIRST}]
    assert entry["packet_count"] >= 3  # two frames of each block of 4,000
    require_nothing_left(network)


def require_named_ends(network: Network, curl: Curl) -> None:
    """Fail unless both ends learn why light does not meet, and let go of all qubits."""
    curl("flowentry/delete", {"match": {"in_port": BOB}})
    with pytest.raises(QuantumSocketError, match="other end's light did not come in time"):
        swapped(network, count=100)
    require_nothing_left(network)
    curl.add(ALICE, output(FIRST), hard_timeout=2)
    with pytest.raises(QuantumSocketError, match="its flow entry ended while it waited there"):
        swapped(network, count=100)
    require_nothing_left(network)
    curl("flowentry/delete", {"match": {"in_port": FIRST}})  # as if its agent were gone
    with pytest.raises(QuantumSocketError, match=r"no outcomes of \d+ pulses from 1 of 1 analyser"):
        swapped(network, count=100)
    require_nothing_left(network)


def test_noise_of_sources_and_of_the_analyser_is_as_the_closed_form_says(tmp_path: Path) -> None:
    # Werner pairs swap to F^2 + (1 - F)^2/3, and a visibility V flips the phase with (1 - V)/2,
    # which makes the target of one of the three other Bell states.
    werner, flip = FIDELITY**2 + (1 - FIDELITY) ** 2 / 3, (1 - VISIBILITY) / 2
    expected = werner * (1 - flip) + (1 - werner) / 3 * flip
    noise = {"fidelity": FIDELITY, "visibility": VISIBILITY}
    with swapping(tmp_path, "ovs-ofctl", **noise) as (network, curl):
        hosts = [each for host in ("alice", "bob") for each in to_host(network, host)]
        curl.add(FIRST, *hosts)  # it takes the place of the one that tells everybody
        figures = swapped(network, count=4000, sample=0.5)
    # F = (1 + XX - YY + ZZ)/4, each of a third of the sample; no correlation varies by more than 1.
    assert abs(figures["fidelity"] - expected) < 5 * sqrt(9 / 16 / figures["sampled"])


def test_halves_wait_in_memories_until_entries_release_them(tmp_path: Path) -> None:
    with swapping(tmp_path, t2_s=T2_S, length_km=10.0) as (network, curl):
        names = {port["port_no"]: port["name"] for port in curl(f"portdesc/{Q1}")}
        assert [names[number] for number in MEMORIES] == ["q1-memory1", "q1-memory2"]
        for fiber, memory in zip((ALICE, BOB), MEMORIES, strict=True):
            curl.add(fiber, output(memory))
            frames = {"in_port": memory, "eth_type": FRAMES}
            curl.add(memory, output(COPPER), match=frames, priority=40_000)
        curl.add(MEMORIES[0], output(FIRST), hard_timeout=3)  # while alice's light waits for bob's
        with pytest.raises(QuantumSocketError, match="nothing released it from the memory there"):
            swapped(network, count=100)
        assert not [flow for flow in curl(f"flow/{Q1}") if flow["hard_timeout"]]
        require_nothing_left(network)
        with pytest.raises(QuantumSocketError, match="or the part of the switch"):
            swapped(network, count=10_000, block_pairs=CAPACITY + 1)
        require_nothing_left(network)
        for memory, port in zip(MEMORIES, (FIRST, SECOND), strict=True):
            curl.add(memory, output(port))
        require_dephased(network)


def waits(log: Path, begin: int = 0) -> list[tuple[float, float]]:
    """Return how long pulses of blocks have waited in memories of switches, by the event log.

    The shortest and the longest of each block.
    """
    line = r"q\d+-memory\d .*recall.* after (\S+?)(?: to (\S+))? s"
    found = re.findall(line, log.read_text()[begin:])
    return [(float(least), float(most or least)) for least, most in found]


def require_dephased(network: Network) -> None:
    """Fail unless pairs have the fidelity that follows from the waits of the event log.

    Halves that wait for t together keep their phase with (1 + exp(-t/T2))/2.
    """
    log = network.runtime.logs / "quantum.log"
    before = len(log.read_text())
    figures = swapped(network, count=4000, sample=0.5)
    waited = waits(log, before)
    waited_s = sum(least for least, _most in waited) / (len(waited) / 2)
    assert waited_s > 0.9e-4  # bob's were there first by more than light takes from him to alice
    expected = (1 + exp(-waited_s / T2_S)) / 2
    assert abs(figures["fidelity"] - expected) < 5 * sqrt(9 / 16 / figures["sampled"])
    require_nothing_left(network)


@pytest.mark.parametrize(
    ("switches", "schedule", "source", "t2_s", "loss_db_per_km"),
    [
        (3, "parallel", FIDELITY, T2_S, LOSS_DB_PER_KM),
        (3, "nested", FIDELITY, T2_S, 0.0),
        pytest.param(1, "parallel", FIDELITY, T2_S, LOSS_DB_PER_KM, marks=pytest.mark.nightly),
        pytest.param(64, "parallel", 0.995, 0.1, 0.0, marks=pytest.mark.nightly),
    ],
)
def test_a_chain_of_switches_has_pairs_as_the_closed_form_says(
    tmp_path: Path,
    switches: int,
    schedule: str,
    source: float,
    t2_s: float,
    loss_db_per_km: float,
) -> None:
    """There are as many pairs as the poorest link has: losses make them fewer and not worse."""
    words = ["--topology", f"chain,{switches}", "--schedule", schedule]
    words += ["--block-pairs", str(BLOCK), "--loss-db-per-km", str(loss_db_per_km)]
    folder = noisy_chain(tmp_path, source, t2_s, *words)
    assert folder.resolve().name.endswith("-swap")
    assert 0.02 < require_closed_form(folder, switches, source, t2_s) < 0.9
    result = json.loads((folder / "result.json").read_text())
    assert result["time"] == "stepped"
    figures = result["job"]["asking"]
    passed = 10 ** (-loss_db_per_km * 10 / 10)
    error = sqrt(passed * (1 - passed) / BLOCK)  # of a link; the least of 2 and of 4 is below
    share, blocks = figures["shared"] / figures["emitted"], figures["emitted"] / BLOCK
    below = {1: 0.564, 3: 1.029}.get(switches, 0) * error
    assert abs(share - passed + below) <= 5 * error / sqrt(blocks)
    require_waits_of_bob(folder / "quantum.log", result["job"]["asked"]["waited_ms"])
    require_waits_of_switches(folder / "quantum.log", result["job"]["asked"])
    assert 0 < figures["sampled_waited_ms"] < 1e3 * figures["elapsed_s"]
    assert "identical" in run_qmn("replay", str(folder)).stdout


def noisy_chain(runs: Path, source: float, t2_s: float, *words: str) -> Path:
    """Run a session over switches whose sources and memories are such; return its folder."""
    more = ["--length-km", "10", "--count", "4000", "--sample", "0.5"]
    more += ["--switch", f"memory.t2_s={t2_s}", "--switch", f"source.fidelity={source}"]
    for host in ("alice", "bob"):
        more += ["--device", f"{host}.source.fidelity={source}"]
    more += ["--without", "report", "--runs", str(runs)]
    done = run_qmn("run", "swap", *words, *more)
    assert done.returncode == 0, done.stdout + done.stderr
    return runs / "latest"


def require_closed_form(folder: Path, switches: int, source: float, t2_s: float) -> float:
    """Fail unless pairs have the fidelity of the closed form; return what X and Y keep by waits.

    Of Werner links F = (1 + 3 w)/4, and w multiplies; a wait t keeps X and Y with exp(-t/T2), and
    pulses that close up to others wait the less, the later they are.
    """
    waited = np.array(waits(folder / "quantum.log"))
    last, first = waited.sum(axis=0) / (len(waited) / (2 * switches)) / t2_s  # in all memories
    closing = first - last
    kept = exp(-last) * (1 - exp(-closing)) / closing if closing else exp(-last)
    werner = ((4 * source - 1) / 3) ** (switches + 1)
    expected = (1 + werner * (1 + 2 * kept)) / 4
    figures = json.loads((folder / "result.json").read_text())["job"]["asking"]
    assert abs(figures["fidelity"] - expected) < 5 * sqrt(9 / 16 / figures["sampled"])
    return float(kept)


def test_an_app_of_os_ken_alone_swaps_over_three_switches(tmp_path: Path) -> None:
    (line,) = documented("examples.repeaters")[1:]
    example = (ROOT / "examples" / "repeaters.py").read_text()
    assert line in example
    assert len(example.splitlines()) <= 60
    words = line.removeprefix("qmn run swap ").split()
    folder = noisy_chain(tmp_path, FIDELITY, 1.0, *words)
    assert require_closed_form(folder, 3, FIDELITY, 1.0) < 0.999
    made = re.findall(r"(q\d-source1) +create +session=(\w+)", (folder / "quantum.log").read_text())
    names = {("q1-source1", f"{Q1:016x}"), ("q2-source1", f"{Q1 + 1:016x}")}
    assert set(made) == names  # those of the app, not of c0


def test_curl_alone_swaps_over_three_switches_as_quisp_does(tmp_path: Path) -> None:
    """Two Werner links, and one switch of three that errs as QuISP's repeater does."""
    (row,) = [each for each in QUISP["figures"] if each["name"] == NOISY_SWAP]
    noise = Gates(
        two_qubit_depolarizing=1 - row["gate"],
        readout_error=1 - row["readout"],
    )
    address = f"127.0.0.1:{free_port()}"
    lines = documented("emit 4097", address)
    functions = [line for line in lines if "() {" in line]
    emits = [line for line in lines if line.startswith("emit 4")]
    topo, rest = (
        Line(3, fidelity=row["fidelity"], noise=noise),
        {"rest": address, "apps": ["ryu.app.ofctl_rest"]},
    )
    with nothing_left(), running(lambda: topo, tmp_path, **rest) as network:
        shell([line for line in lines if line not in emits])
        with ThreadPoolExecutor(1) as threads:
            asked = {"count": 4000, "sample": 0.5, "block_pairs": 16_384, "swaps": 3}
            session = threads.submit(swapped, network, **asked)
            wait_until(lambda: status(network).pairs_created == 2 * 8401, "both ends emit", 10)
            shell(functions + emits)
            figures = session.result(SOON_S)
        assert status(network).pairs_created == 4 * 8401
        require_nothing_left(network)
    fidelity, error = row["swapped"]
    ours = sqrt(9 / 16 / figures["sampled"])
    assert abs(figures["fidelity"] - fidelity) < 5 * sqrt(ours**2 + error**2)


def require_waits_of_bob(log: Path, waited_ms: float) -> None:
    """Fail unless his halves have waited for the outcomes as the event log says."""
    line = r" bob +wait .*block=\d+/0 photons=(\d+) after (\S+) to (\S+) s"
    photons, least_s, most_s = np.array(re.findall(line, log.read_text()), float).T
    mean_s = np.average((least_s + most_s) / 2, weights=photons)
    assert abs(waited_ms - 1e3 * mean_s) < 0.01 * waited_ms


def require_waits_of_switches(log: Path, asked: dict[str, Any]) -> None:
    """Fail unless halves waited in each switch as the event log says, from the opener's on."""
    line = r"q(\d+)-memory\d .*recall.*photons=(\d+) .*after (\S+?)(?: to (\S+))? s"
    found = re.findall(line, log.read_text())
    told_ms = asked["repeaters_waited_ms"]
    assert {int(place) for place, *_rest in found} == set(range(1, len(told_ms) + 1))
    for number, waited_ms in enumerate(told_ms, 1):
        here = [each[1:] for each in found if int(each[0]) == number]
        least_s, most_s = np.array([(least, most or least) for _, least, most in here], float).T
        weights = np.array([photons for photons, *_rest in here], float)
        mean_s = np.average((least_s + most_s) / 2, weights=weights)
        assert abs(waited_ms - 1e3 * mean_s) < 0.02 * waited_ms


def test_failed_parts_entries_agents_and_controllers_that_end_name_the_end_of_sessions(
    tmp_path: Path,
) -> None:
    with nothing_left(), running(lambda: Line(2), tmp_path) as network:
        assert swapped(network, count=100, swaps=2)["pairs"] == 100
        config = dispatcher_of_running_network()
        with ended(network, "that part of it has failed"):
            inject(config, "q2", Failed(60_002))
        wait_until(lambda: "1 of 2 switches" in refusal(network), "c0 knows it", 10)
        inject(config, "q2", Repair())
        wait_until(lambda: not refusal(network), "c0 knows that, too", 10)
        with ended(network, UNHEARD):
            inject(config, "q1", Failed(62_001))  # a source: its next halves are not made
        inject(config, "q1", Repair())
        wait_until(lambda: not refusal(network), "q1's source is whole", 10)
        with ended(network, UNHEARD):
            shell(["ovs-ofctl -O OpenFlow14 del-flows q2 in_port=61001"])  # while a pair waits
        wait_until(lambda: not refusal(network), "the next chain has its entry", 10)
        with ended(network, UNHEARD), restarted_agent(network, "q1"):
            pass
        wait_until(lambda: not refusal(network), "c0 has q1 again", 10)
        with ended(network, "no outcomes of"):
            network.net.controllers[0].program.kill()


@pytest.mark.nightly
def test_a_controller_killed_between_rounds_leaves_nothing_in_memories(tmp_path: Path) -> None:
    policy = tmp_path / "policy.toml"
    policy.write_text('[swap]\nschedule = "nested"\nrounds = 2\n')
    line = {"policy": str(policy)}
    with nothing_left(), running(lambda: Line(2, fidelity=FIDELITY), tmp_path, **line) as network:
        assert swapped(network, count=20, swaps=2)["span_rounds"] == 2
        with ended(network, "(no outcomes of|released it from the memory)"):
            network.net.controllers[0].program.kill()


@contextmanager
def ended(network: Network, text: str) -> Iterator[None]:
    """Fail unless a long session ends with this text by what is done meanwhile, without qubits."""
    before = status(network).pairs_created
    with ThreadPoolExecutor(1) as threads:
        long = threads.submit(swapped, network, count=1_000_000, block_pairs=1000, swaps=2)
        wait_until(lambda: status(network).pairs_created > before + 9000, "it goes on", 20)
        yield
        with pytest.raises(QuantumSocketError, match=text):
            long.result(SOON_S)
    require_nothing_left(network)


def refusal(network: Network) -> str:
    """Return why c0 refuses a chain, empty if it does not."""
    try:
        swapped(network, count=10, swaps=2)
    except QuantumSocketError as error:
        return str(error)
    return ""
