"""Every file of examples/, and every program beside a page of docs/, run as its first lines say.

Others are with what they change: standing_light.py is in test_own_controller.py, flicker.py in
test_run_sdc.py, ageing.py in test_run_device_noise.py, damping.py in test_run_kraus.py,
lying_relay.py in test_run_qkd.py, trunk.py in test_run_load.py, tags.py and played.py in
test_run_tags.py.
"""

import csv
import json
import re
from itertools import pairwise
from pathlib import Path
from uuid import UUID

import numpy as np
import pytest
from conftest import ROOT
from limits import PROGRAM_S
from loaded import run_qmn
from scapy.layers.inet import TCP
from scapy.utils import rdpcap

from topologies.networks.network import Network

EXAMPLES = ROOT / "examples"
DOCS = ROOT / "docs"
PROTOCOLS = {  # programs of applications.qubits, and where they run beside alice
    EXAMPLES / "ghz.py": ("bob", "charlie"),
    DOCS / "netqasm" / "e91.py": ("bob",),
    DOCS / "netqasm" / "teleported_cnot.py": ("bob",),
    DOCS / "netqasm" / "position.py": ("charlie", "bob"),
}


def run(*words: str, cwd: Path = ROOT, commands: str = "") -> str:
    """Run qmn to success; return what it printed."""
    done = run_qmn(*words, cwd=cwd, commands=commands, timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def output(commands: str, runs: Path, *options: str) -> str:
    """Return what the command line of a network prints to these commands."""
    return run("cli", "sdc", *options, "--runs", str(runs), commands=commands)


def result_of(runs: Path) -> dict[str, object]:
    result: dict[str, object] = json.loads((runs / "latest" / "result.json").read_text())
    return result


# The same as the example, with nothing left to be added.
SPELT_OUT = """
from mininet.topo import Topo

from topologies.links import FiberLink
from topologies.nodes import ClassicalSwitch, DispatcherHost, OpticalSwitch, QuantumHost


class SpeltOut(Topo):
    def build(self):
        self.addSwitch("hub", cls=ClassicalSwitch, dpid="1")
        self.addHost("sim", cls=DispatcherHost, ip="10.0.0.100/24")
        for number, name in enumerate(["h1", "h2", "src"], 1):
            self.addHost(name, cls=QuantumHost, ip=f"10.0.0.{number}/24", source=name == "src")
        for number in (1, 2):
            self.addSwitch(f"q{number}", cls=OpticalSwitch, dpid=f"100{number}")
        for node in ("sim", "h1", "h2", "src", "q1", "q2"):
            self.addLink(node, "hub")
        for one, other, fibers in [("h1", "q1", 1), ("h2", "q2", 2), ("src", "q2", 2)]:
            for _ in range(fibers):
                self.addLink(one, other, cls=FiberLink)
        for _ in range(2):
            self.addLink("q1", "q2", cls=FiberLink, length_km=1.0, loss_db_per_km=0.2)
"""


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize(
    ("job", "name", "switch"),
    [("sdc", "MyNet", "s1"), ("sdc", "SpeltOut", "hub"), ("teleport", "MyNet", "s1")],
)
def test_a_topology_of_one_s_own_needs_no_alice_and_no_bob(
    tmp_path: Path, job: str, name: str, switch: str
) -> None:
    (tmp_path / "spelt_out.py").write_text(SPELT_OUT)
    files = {"MyNet": EXAMPLES / "my_net.py", "SpeltOut": tmp_path / "spelt_out.py"}
    own = f"{files[name]}:{name}"
    words = ("run", job, "--topology", own, "--from", "h1", "--to", "h2", "--runs", str(tmp_path))
    printed = run(*words, *(["--frame-bytes", "16"] if job == "sdc" else ["--count", "500"]))
    result = result_of(tmp_path)
    assert result["topology"] == own
    if job == "sdc":
        assert "37 bytes, delivered exactly" in printed
        assert (tmp_path / "latest").resolve().name.endswith(f"-{name}")
        assert captured(tmp_path) == {*(f"{switch}-eth{number}" for number in range(1, 7)), "c0"}
        assert switch in (tmp_path / "latest" / "report.html").read_text()
    else:
        assert re.search(r"^fidelity +1 *$", printed, re.MULTILINE)


def test_the_command_line_takes_a_topology_of_one_s_own(tmp_path: Path) -> None:
    words = ("cli", f"{EXAMPLES}/my_net.py:MyNet", "--runs", str(tmp_path), "--captures", "full")
    assert "h2: hello" in run(*words, commands="h1 qsend h2 hello\n")
    assert "s1-eth1" in captured(tmp_path)


def captured(runs: Path) -> set[str]:
    """Return the names of the newest run's captures."""
    return {file.stem for file in (runs / "latest").glob("*.pcap")}


def listening(program: Path, log: Path) -> str:
    """Return commands that start a program on bob and wait until it listens."""
    until = f"bob timeout 30 sh -c 'until grep -q listening {log}; do sleep 0.1; done'"
    return f"bob python {program} > {log} &\n{until}\n"


def test_a_socket_says_hello(tmp_path: Path) -> None:
    log = tmp_path / "log"
    alice = f"alice python {EXAMPLES}/hello.py bob 'how are you?'\n"
    printed = output(
        listening(EXAMPLES / "hello.py", log) + alice + "bob wait\n", tmp_path / "runs"
    )
    # 12 bytes of four pairs each, by Hamming(7,4) seven fourths of that.
    assert "sent, by 84 Bell pairs" in printed
    assert log.read_text() == "listening\n10.0.0.1: how are you?\n"


@pytest.mark.nightly
def test_the_example_waits_for_a_listener_that_begins_later(tmp_path: Path) -> None:
    log, program = tmp_path / "log", EXAMPLES / "hello.py"
    bob = f"bob sh -c 'sleep 2; python {program}' > {log} &\n"
    printed = output(f"{bob}alice python {program} bob hello\nbob wait\n", tmp_path / "runs")
    assert "sent, by 35 Bell pairs" in printed  # 5 bytes: 20 pairs, times 7/4
    assert log.read_text() == "listening\n10.0.0.1: hello\n"


def printed_by(file: Path, network: Network, folder: Path) -> dict[str, list[str]]:
    """Run a program of applications.qubits at its hosts; return the words that each has printed."""
    others = PROTOCOLS[file]
    for host in others:
        network.host(host).cmd(f"python {file} > {folder}/{host} &")
    network.host("alice").cmd(f"python {file} > {folder}/alice")
    for host in others:
        network.host(host).cmd("wait")
    return {host: (folder / host).read_text().split() for host in ("alice", *others)}


def test_three_hosts_find_what_a_ghz_state_says(shared_network: Network, tmp_path: Path) -> None:
    """The same along Z, an even number of ones along X, in turns."""
    found = dict(printed_by(EXAMPLES / "ghz.py", shared_network, tmp_path).values())
    states = list(zip(*(found[host] for host in ("alice", "bob", "charlie")), strict=True))
    assert len(states) == 12
    assert all(len(set(state)) == 1 for state in states[::2]), states
    assert all(state.count("1") % 2 == 0 for state in states[1::2]), states


@pytest.mark.nightly
def test_ekert_s_protocol_makes_one_key_and_s_of_chsh(
    shared_network: Network, tmp_path: Path
) -> None:
    """Of 1,920 pairs one in nine has each two axes; a product along two has variance 1/2."""
    found = printed_by(DOCS / "netqasm" / "e91.py", shared_network, tmp_path)
    alice, bob = (found[host] for host in ("alice", "bob"))
    assert alice[1:] == bob[1:]
    _host, _s, s, _key, key = alice
    pairs = 8 * 240
    assert abs(float(s) - 2 * np.sqrt(2)) < 5 * np.sqrt(4 * 0.5 / (pairs / 9))
    assert abs(len(key) - pairs * 2 / 9) < 5 * np.sqrt(pairs * 2 / 9 * 7 / 9)


@pytest.mark.nightly
def test_a_cnot_between_two_hosts_is_one(shared_network: Network, tmp_path: Path) -> None:
    """Of controls 0, 1, + and + in turns and targets 0; the last are measured along X."""
    found = printed_by(DOCS / "netqasm" / "teleported_cnot.py", shared_network, tmp_path)
    ours, theirs = (found[host][1] for host in ("alice", "bob"))
    assert ours == theirs
    assert set(ours[::4]) == {"0"}
    assert set(ours[1::4]) == {"1"}
    # Twenty by chance: all the same in one run of half a million.
    assert len(ours) == 40
    assert len(set(ours[2::4] + ours[3::4])) == 2


@pytest.mark.nightly
def test_who_measures_before_the_bases_are_told_is_not_where_he_should_be(
    shared_network: Network, tmp_path: Path
) -> None:
    """Of 120 outcomes along bases by chance, a quarter is wrong."""
    found = printed_by(DOCS / "netqasm" / "position.py", shared_network, tmp_path)
    line = " ".join(found["charlie"])
    reports = re.findall(r"(in place|elsewhere): (\d+) of (\d+) wrong, ([\d.]+) ms, (\d+) km", line)
    (_place, wrong, pairs, *_), (_other, guessed, *_rest) = reports
    assert (int(wrong), int(pairs)) == (0, 120)
    assert abs(int(guessed) - 30) < 5 * np.sqrt(120 * 0.25 * 0.75)
    for _place, _wrong, _pairs, elapsed_ms, km in reports:
        assert abs(float(elapsed_ms) / 2e3 * 204_000 - float(km)) < 12  # as far as it is rounded


@pytest.mark.nightly
def test_where_nobody_listens_the_example_says_so_in_a_line(tmp_path: Path) -> None:
    commands = f"alice python {EXAMPLES}/hello.py bob hello || echo status $?\n"
    printed = output(commands, tmp_path)
    assert re.search(r"^hello: .+\nstatus 1$", printed.replace("\r", ""), re.MULTILINE), printed
    assert "Traceback" not in printed


@pytest.mark.nightly
def test_coins_fall_alike_as_often_as_the_fidelity_says() -> None:
    printed = run("script", str(EXAMPLES / "coins.py"))
    (alike,) = re.findall(r"^alike: (\d+) of 1000$", printed, re.MULTILINE)
    # A Werner pair of fidelity .9 is wrong along Z with 2 (1 - F) / 3.
    expected = (2 * 0.9 + 1) / 3
    assert abs(int(alike) - 1000 * expected) < 5 * (1000 * expected * (1 - expected)) ** 0.5
    assert int(alike) < 1000


@pytest.mark.nightly
def test_a_message_survives_the_cut_of_a_fibre() -> None:
    printed = run("script", str(EXAMPLES / "fiber_cut.py"))
    assert "1,000,000 bytes arrived, exactly: True" in printed
    ways = re.findall(r"^now by (.*)$", printed, re.MULTILINE)
    assert len(ways) == 3
    assert not any({"q1 q2", "q2 q1"} & {way[i : i + 5] for i in range(len(way))} for way in ways)


@pytest.mark.nightly
def test_openssl_talks_tls_by_a_key_of_photons(tmp_path: Path) -> None:
    program = DOCS / "keys" / "tls_psk.py"
    alice = f"alice python {program} bob 'hello there'\n"
    commands = listening(program, tmp_path / "log") + alice + "bob wait\n"
    printed = output(commands, tmp_path / "runs", "--key-pair", "alice:bob", "--captures", "full")
    assert "ereht olleh" in printed
    assert "Protocol version: TLSv1.3" in printed
    assert "No peer certificate" in printed
    sent: dict[int, dict[int, bytes]] = {5003: {}, 5443: {}}  # once, what TCP has repeated
    for packet in rdpcap(str(tmp_path / "runs" / "latest" / "s1-eth1.pcap")):
        if TCP in packet and packet[TCP].dport in sent and packet[TCP].payload:
            sent[packet[TCP].dport][packet[TCP].seq] = bytes(packet[TCP].payload)
    report, spoken = (b"".join(segments.values()) for segments in sent.values())
    key_id = UUID(report.decode().strip())
    assert str(key_id).encode() in spoken  # the identity, in ClientHello
    assert b"hello" not in spoken


@pytest.mark.nightly
def test_an_alarm_closes_the_fibre_that_somebody_taps() -> None:
    printed = run("script", str(DOCS / "tamper-seal" / "watched.py"))
    moments = re.findall(r"^ *[0-9.]+ s  (.*)$", printed, re.MULTILINE)
    tapped = moments.index("somebody measures 0.5 of the photons between q2 and q3")
    closed = moments.index("closed: q2-q3")
    assert "message arrived: True" in moments[:tapped]
    assert any(each.startswith("charlie to bob: whole") for each in moments[:tapped])
    assert not any("ALARM" in each for each in moments[:tapped])
    (alarm,) = (each for each in moments if "ALARM" in each)
    assert alarm.startswith("charlie to bob: ALARM")
    assert tapped < moments.index(alarm) < closed
    # There a quarter of the symbols at least would be wrong: X and Z, each of one photon in eight.
    assert "message arrived: True, errors 0" in moments[closed:]
    ways = [each.split()[2:] for each in moments[closed:] if each.startswith("now by")]
    assert len(ways) == 3
    for way in ways:
        assert {"q2", "q3"} not in map(set, pairwise(way))


@pytest.mark.nightly
def test_the_sweep_measures_every_code(tmp_path: Path) -> None:
    run("lab", "sweep", str(EXAMPLES / "codes.toml"), "--out", str(tmp_path))
    with (tmp_path / "sdc.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == 18
    for row in rows:
        p, error = float(row["depolarizing"]), float(row["dibit_error"])
        deviation = np.sqrt(0.75 * p * (1 - 0.75 * p) / 60_000)
        assert abs(error - 0.75 * p) < 5 * deviation, row
