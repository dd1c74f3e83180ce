"""`qmn netqasm` from outside: applications of NetQASM's SDK, as they are, over real components."""

import cmath
import json
import re
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any

import netqasm.examples.apps
import pytest
from documentation import blocks
from loaded import run_qmn
from scapy.layers.inet import IP, TCP
from scapy.utils import PcapReader

from applications.netqasm.carried import CarriedApplication
from applications.netqasm.job import checked, play
from applications.netqasm.request import NetqasmRequest
from applications.processing_unit.pair_requests import (
    PAIRS_PORT,
    REQUEST,
    PairRequest,
    Use,
    decode_request,
)
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from topologies.networks.network import Network
from topologies.nodes import QuantumHost

APPS = Path(netqasm.examples.apps.__file__).parent
RANKS = Path(__file__).parents[1] / "unit/applications/netqasm_styles/netqmpi"


def run(runs: Path, application: str, *options: str) -> dict[str, Any]:
    """Run an application to its end; return result.json."""
    words = str(APPS / application), "--without", "report", "--runs", str(runs)
    done = run_qmn("netqasm", *words, *options)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    assert result["delivered"] is True
    return result


def played(
    network: Network, folder: Path, path: Path, rounds: int = 1, **options: Any
) -> list[dict[str, Any]]:
    """Run an application on a network that stands; return what its roles do, round by round."""
    for log in network.runtime.logs.glob("netqasm-*.log"):
        log.unlink()
    request = NetqasmRequest(
        path=path,
        rounds=rounds,
        network=NetworkOptions(),
        run=RunOptions(runs=folder),
        **options,
    )
    hosts = [host.name for host in network.net.hosts if isinstance(host, QuantumHost)]
    application = checked(request, hosts)
    outputs: list[Any] = []
    copies = CarriedApplication(application.path, list(application.hosts.values()), folder)
    play(application, copies, network, folder, outputs, lambda: None)
    return outputs


def asked(captures: list[str]) -> set[PairRequest]:
    """Return what units have asked each other for."""
    found = set()
    for capture in captures:
        with PcapReader(capture) as packets:
            for packet in packets:
                if TCP in packet and packet[TCP].dport == PAIRS_PORT:
                    payload = bytes(packet[TCP].payload)
                    if len(payload) == REQUEST.size:
                        assert packet[IP].dst == "10.0.0.2"  # bob
                        found.add(decode_request(payload))
    return found


def agreements(logs: Path) -> list[bool]:
    """Return whether the two programs of the application have found the same, pair by pair."""
    reports = []
    for role in ("client", "server"):
        lines = (logs / f"netqasm-{role}.log").read_text().splitlines()
        begin = f"{role.capitalize()}: "
        reports.append([int(line[len(begin) :]) for line in lines if line.startswith(begin)])
    return [ours == theirs for ours, theirs in zip(*reports, strict=True)]


def test_pairs_are_measured_at_both_ends_of_a_noisy_network(tmp_path: Path) -> None:
    """The application measures ten pairs along Y, where the outcomes of Phi+ differ.

    Each half passes two fibres that depolarise with p: they agree with (1 - (1 - p)^4) / 2.
    """
    p, rounds = 0.15, 12
    words = ["--rounds", str(rounds), "--depolarizing", str(p)]
    places = ["--place", "client=alice", "--place", "server=bob"]
    result = run(tmp_path, "link_layer_md", *places, *words)
    alike = agreements(tmp_path / "latest")
    assert len(alike) == 10 * rounds
    wrong = (1 - (1 - p) ** 4) / 2
    assert abs(sum(alike) / len(alike) - wrong) < 5 * sqrt(wrong * (1 - wrong) / len(alike))
    (request,) = asked(result["captures"])
    assert (request.creator, request.pairs, request.use) == ("alice", 10, Use.MEASURE)
    assert result["path_setup_ms"]["n"] == rounds  # light, as the controller grants it


@pytest.mark.nightly
def test_pairs_of_ion_traps_are_heralded_by_a_station(tmp_path: Path) -> None:
    """F = .94 by their paper, as Werner pairs, measured along Y: they agree with 2 (1 - F) / 3."""
    rounds, fidelity = 8, 0.94
    words = ["--rounds", str(rounds), "--node", "ion-trap", "--switch", "parts=station"]
    places = ["--place", "client=alice", "--place", "server=bob", "--length-km", "0.01"]
    run(tmp_path, "link_layer_md", *places, *words)
    assert "q1-analyser1 herald" in (tmp_path / "latest" / "quantum.log").read_text()
    alike, wrong = agreements(tmp_path / "latest"), 2 * (1 - fidelity) / 3
    assert len(alike) == 10 * rounds
    assert abs(sum(alike) / len(alike) - wrong) < 5 * sqrt(wrong * (1 - wrong) / len(alike))


def differing(logs: Path) -> dict[str, list[bool]]:
    """Return of which pairs that each two of three nodes share the outcomes differ."""
    found = {
        name: re.findall(rf"{name}: +m_(\w+): *([01])$", log.read_text(), re.MULTILINE)
        for name in ("alice", "bob", "charlie")
        for log in [logs / f"netqasm-{name}.log"]
    }
    outcomes = {
        (name, peer): [outcome for other, outcome in reports if other == peer]
        for name, reports in found.items()
        for peer in found
    }
    pairs = [("alice", "bob"), ("alice", "charlie"), ("bob", "charlie")]
    return {
        one + other: [
            ours != theirs
            for ours, theirs in zip(outcomes[one, other], outcomes[other, one], strict=True)
        ]
        for one, other in pairs
    }


def test_each_of_three_nodes_shares_pairs_with_the_others(
    netqasm_network: Network, tmp_path: Path
) -> None:
    """The programs tell NetQASM's logger alone what they find."""
    played(netqasm_network, tmp_path, APPS / "three_nodes", rounds=4)
    assert list(differing(netqasm_network.runtime.logs).values()) == [[False] * 4] * 3


@pytest.mark.nightly
def test_three_nodes_have_as_noisy_pairs_as_their_ways_are_long(tmp_path: Path) -> None:
    """Charlie makes the pairs: light to him passes no fibre, to another two, each with p."""
    p, rounds = 0.6, 40
    run(tmp_path, "three_nodes", "--rounds", str(rounds), "--depolarizing", str(p))
    for peers, differ in differing(tmp_path / "latest").items():
        wrong = (1 - (1 - p) ** (2 if "charlie" in peers else 4)) / 2
        bound = 5 * sqrt(wrong * (1 - wrong) / rounds)
        assert bound < wrong  # without noise this would fail
        assert len(differ) == rounds
        assert abs(sum(differ) / rounds - wrong) < bound


def test_the_teleport_of_the_sdk_runs_as_it_is(netqasm_network: Network, tmp_path: Path) -> None:
    record = netqasm_network.runtime.logs / "quantum.log"
    before = len(record.read_text())
    given = ("sender.theta=1.1",)
    outputs = played(netqasm_network, tmp_path, APPS / "teleport", rounds=4, input=given)
    log = record.read_text()[before:]
    for host, instruction in (("alice", "recv_epr"), ("bob", "create_epr"), ("bob", "cnot Q0 Q1")):
        assert re.search(rf" {host} +subroutine +set [^\n]*{instruction}", log)
    assert len(outputs) == 4
    for each in outputs:
        sent, done = each["sender"], each["receiver"]
        assert done["correction1"] == ("Z" if sent["m1"] else "None")
        assert done["correction2"] == ("X" if sent["m2"] else "None")


def test_the_netqmpi_program_of_the_documentation_runs_on_a_host_for_each_rank(
    netqasm_network: Network, tmp_path: Path
) -> None:
    """Rank 0 teleports 1; without corrections one in 2 ** rounds would be right."""
    (text,) = [each for each in blocks("docs/netqasm.md", "python") if "comm.qsend" in each]
    program, rounds = tmp_path / "send.py", 12
    program.write_text(text)
    logs, place = netqasm_network.runtime.logs, ("rank_0=charlie",)
    before = len((logs / "quantum.log").read_text())
    outputs = played(netqasm_network, tmp_path, program, rounds, ranks=2, place=place)
    assert outputs == [{"rank_0": {"0": rounds}, "rank_1": {"1": rounds}}]
    for role, counts in outputs[0].items():  # a program says its own alone
        log = (logs / f"netqasm-{role}.log").read_text()
        assert re.findall(r"^\{(?:'.*)?\}$", log, re.MULTILINE) == [str(counts)]
    quantum = (logs / "quantum.log").read_text()[before:]
    for host, instruction in (("charlie", "create_epr"), ("alice", "recv_epr")):
        assert re.search(rf" {host} +subroutine +set [^\n]*{instruction}", quantum)


def test_what_a_netqmpi_program_scatters_and_flips_is_gathered(
    netqasm_network: Network, tmp_path: Path
) -> None:
    """Charlie scatters |1> and |0>, and gathers |0> and |1> behind his own |1>."""
    program, place = RANKS / "scattered.py", ("rank_0=charlie",)
    outputs = played(netqasm_network, tmp_path, program, 3, ranks=3, place=place)
    assert outputs == [{"rank_0": {"101": 3}, "rank_1": {"": 3}, "rank_2": {"": 3}}]


def test_a_state_comes_over_and_nobody_knows_from_whom(
    netqasm_network: Network, tmp_path: Path
) -> None:
    """Anonymous transmission by four hosts: GHZ states that they make, and one teleportation."""
    phi, theta = 0.7, 1.1
    given = ["alice.sender=true", f"alice.phi={phi}", f"alice.theta={theta}"]
    given.append("charlie.receiver=true")
    path, rounds = APPS / "anonymous_transmission", 4  # by chance one in four would be right
    options = {"input": tuple(given), "place": ("david=eve",)}
    outputs = played(netqasm_network, tmp_path, path, rounds, **options)
    assert len(outputs) == rounds
    state = cos(theta / 2), cmath.exp(1j * phi) * sin(theta / 2)
    for each in outputs:
        fidelity = overlap(each["charlie"]["qubit_state"], state)
        assert abs(fidelity - 1) < 1e-6  # the SDK meets an angle to 1e-4 of pi


@pytest.mark.nightly
def test_anonymous_transmission_is_as_good_as_the_pairs_of_its_ghz_states(tmp_path: Path) -> None:
    """Pairs of alice and bob pass four fibres, those that charlie makes of his own two: W1, W2, W3.

    A pair that is fully mixed is a random Pauli operator. An X of it flips all GHZ qubits behind
    it, a Z the phase of the whole. So of the two bits in the parity of a GHZ state each is wrong
    with (1 - W1 W2 W3) / 2. The pair that alice and charlie get out of the first one
    is flipped by X of the two links between them, and by Z of all three.
    """
    rounds, w, phi, theta = 24, 0.7, 0.7, 1.1
    w1, w2, w3 = w**2, w, w
    of_x, of_z = (w1 * w2) * (w1 * w2 * w3), (w1 * w2 * w3) ** 2  # mean signs of both flips
    of_both = (w1 * w2) * w3 * (w1 * w2 * w3) ** 2
    bloch = sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)
    kept = of_z, of_both, of_x  # of the state along X, Y and Z
    expected = (1 + sum(n**2 * each for n, each in zip(bloch, kept, strict=True))) / 2
    words = ["--topology", "tapped", "--place", "david=eve", "--rounds", str(rounds)]
    words += ["--depolarizing", str(1 - sqrt(w)), "--captures", "none", "--without", "events"]
    for given in ("alice.sender=true", f"alice.phi={phi}", f"alice.theta={theta}"):
        words += ["--input", given]
    result = run(tmp_path, "anonymous_transmission", *words, "--input", "charlie.receiver=true")
    state = cos(theta / 2), cmath.exp(1j * phi) * sin(theta / 2)
    found = [overlap(each["charlie"]["qubit_state"], state) for each in result["job"]["outputs"]]
    assert len(found) == rounds
    bound = 4 * sqrt(expected * (1 - expected) / rounds)
    assert bound < 1 - expected
    assert abs(sum(found) / rounds - expected) < bound


def overlap(rows: Any, state: tuple[complex, ...]) -> float:
    """Return the fidelity of a density matrix of JSON with a state."""
    return sum(
        state[i].conjugate() * complex(*rows[i][j]) * state[j] for i in (0, 1) for j in (0, 1)
    ).real


CURIOUS = """
import os
from pathlib import Path

def main(app_config=None):
    (run,) = Path("/run/qmn").iterdir()
    shown = sorted(str(path.relative_to(run)) for path in run.rglob("*"))
    others = [Path("/proc", pid, "cmdline").read_bytes() for pid in os.listdir("/proc")
              if pid.isdigit() and int(pid) != os.getpid()]
    return {"shown": shown, "dispatcher": any(b"dispatcher" in each for each in others)}
"""


def test_a_program_sees_of_the_run_what_its_host_is_shown(tmp_path: Path) -> None:
    application = tmp_path / "curious"
    application.mkdir()
    (application / "app_alice.py").write_text(CURIOUS)
    run(tmp_path / "runs", str(application))
    result = json.loads((tmp_path / "runs" / "latest" / "result.json").read_text())
    ((output,),) = [list(each.values()) for each in result["job"]["outputs"]]
    own = ["alice", "alice/alice.sock", "keys", "keys/alice", "time", "time/gate", "time/page"]
    own += ["written", "written/alice"]
    assert [path for path in output["shown"] if path.count("/") < 2] == own
    assert not output["dispatcher"]


SIMULATED = {  # as `netqasm simulate` has them: roles are at nodes of a network of its own
    "app_alice.py": """
from netqasm.sdk import EPRSocket, Qubit
from netqasm.sdk.classical_communication.message import StructuredMessage
from netqasm.sdk.external import NetQASMConnection, Socket

def main(app_config=None):
    texts, pairs = Socket("alice", "bob"), EPRSocket("bob")
    with NetQASMConnection("alice", epr_sockets=[pairs], max_qubits=3) as unit:
        one = Qubit(unit)
        one.X()
        one = one.measure()
        unit.flush()
        texts.send_structured(StructuredMessage("found", {"at": [one]}))
        outcomes = []
        for _ in range(2):
            (half,), (info,) = pairs.create_keep_with_info()
            outcomes.append(half.measure())
            unit.flush()
    return {"one": one, "outcomes": outcomes, "light": info.generation_duration}
""",
    "app_bob.py": """
from netqasm.sdk import EPRSocket
from netqasm.sdk.external import NetQASMConnection, Socket

def main(app_config=None):
    texts, pairs = Socket("bob", "alice"), EPRSocket("alice")
    with NetQASMConnection("bob", epr_sockets=[pairs]) as unit:
        payload = texts.recv_structured().payload
        halves, infos = pairs.recv_keep_with_info(2)
        outcomes = [half.measure() for half in halves]
    return {"payload": payload, "outcomes": outcomes,
            "light": [info.generation_duration for info in infos]}
""",
    "roles.yaml": "alice: delft\nbob: leiden\n",
    "network.yaml": "nodes: []\nlinks:\n"
    "- {name: ch, node_name1: delft, node_name2: leiden, noise_type: Bitflip, fidelity: 0.9}\n",
}


def test_outcomes_are_the_same_in_programs_messages_and_results(
    netqasm_network: Network, tmp_path: Path
) -> None:
    """X|0> is 1; of Phi+ outcomes are alike, pair by pair, however each end counts its requests."""
    application = tmp_path / "simulated"
    application.mkdir()
    for name, text in SIMULATED.items():
        (application / name).write_text(text)
    outputs = played(netqasm_network, tmp_path, application, 3)
    assert len(outputs) == 3
    for each in outputs:
        alice, bob = each["alice"], each["bob"]
        assert (alice["one"], bob["payload"]) == (1, {"at": [1]})
        assert alice["outcomes"] == bob["outcomes"]
        first, both = bob["light"]  # in us, the second with the light of the first
        assert 0 < first < 1000
        assert both == first + alice["light"]
