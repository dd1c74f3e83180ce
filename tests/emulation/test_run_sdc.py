"""`qmn run sdc` from outside, over the real components."""

import json
import os
import re
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, qmn, qmn_command, verb
from limits import PROGRAM_S, SOON_S
from scapy.layers.inet import IP, TCP
from scapy.utils import PcapReader, rdpcap
from test_results_fit_schema import require_schema

from topologies.system.processes.programs import ENVIRONMENT
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.header import METADATA_PORT
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Verdict
from wire.pcapng import Reader

SEQUENTIAL = "one"  # is sent by handshakes that wait for each other
RESULT_KEYS = {
    "topology",
    "mode",
    "controller",
    "seed",
    "hosts",
    "delivered",
    "sessions",
    "pairs_made",
    "photons_lost",
    "elapsed_s",
    "path_setup_ms",
    "job",
    "packet_in_count",
    "captures",
    "timeline",
    "backend",
    "exact",
    "devices",
}


def run(runs: Path, *arguments: str) -> dict[str, Any]:
    """Run to success and return the result."""
    done = qmn(*arguments, runs=runs)
    assert done.returncode == 0, done.stdout + done.stderr
    require_schema(runs / "latest")
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


@pytest.fixture(scope="module")
def short_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return the folder and the result of a run with a short message."""
    runs = tmp_path_factory.mktemp("runs")
    return runs / "latest", run(runs, "--message", "captured")


def test_a_report_that_was_not_wanted_can_be_made_later(
    short_run: tuple[Path, dict[str, Any]],
) -> None:
    folder, _ = short_run
    assert not (folder / "report.html").exists()
    verb("report", str(folder))
    assert "<figure" in (folder / "report.html").read_text()


@pytest.mark.image
@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("controller", ["ryu", "os-ken"])
@pytest.mark.parametrize("handshake", ["framed", "per-pair"])
def test_bob_holds_exactly_what_alice_sent(tmp_path: Path, controller: str, handshake: str) -> None:
    message = "dense "
    result = run(
        tmp_path, "--message", message, "--controller", controller, "--handshake", handshake
    )
    assert result.keys() >= RESULT_KEYS
    assert (tmp_path / "latest" / "received").read_text() == message
    assert result["delivered"] is True
    carried, sent = result["job"]["message"], result["job"]["asking"]
    assert carried["sha256_sent"] == carried["sha256_received"]
    assert (result["controller"], result["parameters"]["handshake"]) == (controller, handshake)
    assert (sent["bell_pairs"], sent["lost_pairs"]) == (4 * len(message), 0)
    assert sent["symbol_error_rate"] == 0.0
    assert (result["backend"], result["exact"]) == ("chp", True)
    set_ups = {"framed": 1, "per-pair": 4 * len(message)}[handshake]
    assert result["path_setup_ms"]["n"] == set_ups


@pytest.fixture(scope="module")
def sequential_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return the folder and the result of a run with sequential handshakes and short captures."""
    runs = tmp_path_factory.mktemp("runs")
    words = "--message", SEQUENTIAL, "--handshake", "sequential", "--captures", "headers"
    return runs / "latest", run(runs, *words)


def test_each_pair_of_sequential_handshakes_has_a_light_path_of_its_own(
    sequential_run: tuple[Path, dict[str, Any]],
) -> None:
    folder, result = sequential_run
    assert (folder / "received").read_text() == SEQUENTIAL
    pairs = 4 * len(SEQUENTIAL)
    assert (result["job"]["asking"]["bell_pairs"], result["path_setup_ms"]["n"]) == (pairs, pairs)
    events = [json.loads(line) for line in (folder / "controller.jsonl").read_text().splitlines()]
    paths = [each["event"] for each in events if each["event"] in ("path_ready", "torn_down")]
    assert paths[: 2 * pairs] == ["path_ready", "torn_down"] * pairs


def test_captures_of_headers_hold_set_up_messages_whole_and_little_else(
    sequential_run: tuple[Path, dict[str, Any]],
) -> None:
    folder, result = sequential_run
    packets = [packet for file in folder.glob("s1-*.pcap") for packet in rdpcap(str(file))]
    assert max(len(packet) for packet in packets) <= 640
    setups = [packet for packet in packets if TCP in packet and setup_in(packet) is not None]
    assert len(setups) >= result["job"]["asking"]["bell_pairs"]


def test_wireshark_reads_grpc_from_the_beginning_of_each_connection(
    short_run: tuple[Path, dict[str, Any]],
) -> None:
    folder, _ = short_run
    wanted = ["-Y", "grpc", "-T", "fields", "-e", "http2.header.value"]
    for host in ("s1-eth1", "s1-eth2", "s1-eth3"):  # alice's, bob's and charlie's
        read_as = ["-r", str(folder / f"{host}.pcap"), "-d", "tcp.port==50051,http2"]
        command = ["tshark", *read_as, *wanted]
        read = subprocess.run(command, capture_output=True, text=True, check=True, timeout=SOON_S)
        assert "/qmn.Dispatcher/Challenge" in read.stdout


def test_qmn_by_itself_forks_off_programs_that_say_in_their_logs_what_they_do(
    tmp_path: Path,
) -> None:
    environment = {**os.environ, **ENVIRONMENT}  # as bin/qmn has it
    subprocess.run(qmn_command(tmp_path), cwd=ROOT, env=environment, check=True, timeout=PROGRAM_S)
    run = tmp_path / "latest"
    assert "INFO serving on" in (run / "dispatcher.log").read_text()
    assert "INFO bridge and controller" in (run / "q1-agent.log").read_text()


def test_a_binary_file_of_many_blocks_arrives(tmp_path: Path) -> None:
    file = tmp_path / "file with spaces"
    file.write_bytes(bytes(range(256)) * 300)
    result = run(tmp_path, "--file", str(file), "--block-pairs", "65536")
    assert (tmp_path / "latest" / "received").read_bytes() == file.read_bytes()
    assert result["job"]["asking"]["bell_pairs"] == 4 * 76_800
    log = (tmp_path / "latest" / "quantum.log").read_text()
    measured = re.findall(r" bell-measure .* block=(\d+)/0 photons=(\d+) ", log)
    assert [int(number) for number, _photons in measured] == [1, 2, 3, 4, 5]
    assert sum(int(photons) for _number, photons in measured) == 4 * 76_800
    assert " photon=" not in log
    lengths = [
        (packet.wirelen or 0, len(packet)) for file in result["captures"] for packet in rdpcap(file)
    ]
    assert max(lengths)[0] > 1_500
    assert [whole for whole, captured in lengths if captured < whole] == []


@pytest.mark.nightly
def test_an_empty_file_arrives(tmp_path: Path) -> None:
    file = tmp_path / "empty"
    file.touch()
    result = run(tmp_path, "--file", str(file))
    assert (result["job"]["message"]["bytes"], result["job"]["asking"]["bell_pairs"]) == (0, 0)
    assert (tmp_path / "latest" / "received").read_bytes() == b""


@pytest.mark.nightly
def test_a_message_tells_how_long_it_took_in_the_network(tmp_path: Path) -> None:
    """200 pairs of a source of 1000 a second: a fifth of a second, which takes four here."""
    message, scale, since_s = "x" * 50, 20, time.monotonic()
    words = ("--rate-hz", "1000", "--time", f"paced={scale}")
    result = run(tmp_path, "--message", message, *words)
    wall_s = time.monotonic() - since_s
    assert 0.2 <= result["elapsed_s"] <= wall_s / scale
    rate = result["job"]["asking"]["bell_pairs"] / result["elapsed_s"]
    assert result["job"]["asking"]["pairs_per_s"] == pytest.approx(rate)


@pytest.mark.nightly
def test_the_experiment_of_2017_has_its_symbol_errors(tmp_path: Path) -> None:
    result = run(tmp_path, "--preset", "fiber-2017", "--frame-bytes", "8")
    sent = result["job"]["asking"]
    pairs, expected = sent["bell_pairs"], 0.75 * 0.0598
    errors = sent["symbol_errors"]
    assert abs(errors - pairs * expected) < 5 * (pairs * expected * (1 - expected)) ** 0.5
    assert sent["lost_pairs"] == 0


@pytest.mark.nightly
def test_detectors_lose_pairs_and_a_source_of_many_pairs_is_not_exact(tmp_path: Path) -> None:
    options = ["--message", "device " * 100, "--device", "bob.detectors.efficiency=0.8"]
    result = run(tmp_path, *options)
    pairs, expected = result["job"]["asking"]["bell_pairs"], 1 - 0.8**2
    errors = abs(result["job"]["asking"]["lost_pairs"] - pairs * expected)
    assert errors < 5 * (pairs * expected * (1 - expected)) ** 0.5
    assert result["exact"] is True
    assert result["devices"]["bob"] == {"detectors": {"efficiency": 0.8}}
    options = ["--message", "device " * 10, "--frame-bytes", "4"]
    # Pairs of one pulse tell the same Bell state, unless a photon of one of them is lost.
    options += ["--fiber", "loss_db_per_km=100"]
    options += ["--device", "charlie.source.statistics=poisson"]
    options += ["--device", "charlie.source.mean_pairs=0.3"]
    result = run(tmp_path, *options)
    assert result["exact"] is False
    events = (tmp_path / "latest" / "quantum.log").read_text()
    assert "in weak pulses" in events
    assert "double=" in events


@pytest.mark.nightly
def test_a_noise_model_of_the_user_s_own_acts_on_every_fibre(tmp_path: Path) -> None:
    noise = f"noise={ROOT / 'examples' / 'flicker.py'}:Flicker"
    parameters = 'noise_parameters={"flip": 0.005, "switched": 0}'
    arguments = ["--fiber", noise, "--fiber", parameters, "--frame-bytes", "8"]
    result = run(tmp_path, *arguments, "--message", "flicker " * 100)
    pairs = result["job"]["asking"]["bell_pairs"]
    # Six fibres that flip: an odd number of times with (1 - .99^6) / 2.
    expected = (1 - 0.99**6) / 2
    errors = result["job"]["asking"]["symbol_errors"]
    assert abs(errors - pairs * expected) < 5 * (pairs * expected * (1 - expected)) ** 0.5
    assert result["every_fiber"]["noise_parameters"] == {"flip": 0.005, "switched": 0}


@pytest.mark.nightly
def test_a_noise_model_that_answers_nonsense_ends_the_run_and_is_named(tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("class Bad:\n    def effect(self, passage): return 5\n")
    done = qmn("--fiber", f"noise={tmp_path / 'bad.py'}:Bad", runs=tmp_path)
    assert done.returncode == 1
    assert "bad.py:Bad: effect gave 5; return an Effect" in done.stderr


def test_losses_and_errors_are_repaired_and_counted(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(bytes(range(256)) * 2)
    options = ["--length-km", "1", "--loss-db-per-km", "0.5", "--depolarizing", "0.004"]
    result = run(tmp_path, "--file", str(file), *options, "--frame-bytes", "32")
    assert (tmp_path / "latest" / "received").read_bytes() == file.read_bytes()
    pairs = result["job"]["asking"]["bell_pairs"]
    # Three light paths of two fibres each; a pair is lost unless all six let it through, and the
    # delay line of 2 km in which one half waits for the one that goes by way of alice.
    lost = 1 - 10 ** (-(6 * 0.5 + 2 * 0.2) / 10)
    sent = result["job"]["asking"]
    assert abs(sent["lost_pairs"] - pairs * lost) < 5 * (pairs * lost * (1 - lost)) ** 0.5
    assert sent["symbol_error_rate"] > 0
    assert sent["repeated_frames"] > 0


def test_files_that_become_too_long_end_and_the_run_goes_on(tmp_path: Path) -> None:
    """It says which; each that has ended is whole, and the record is replayed as far as it goes."""
    (tmp_path / "file").write_bytes(bytes(range(256)) * 128)
    words = ["--file", str(tmp_path / "file"), "--frame-bytes", "32", "--file-gib", "1e-05"]
    done = qmn(*words, runs=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    folder = tmp_path / "latest"
    result = json.loads((folder / "result.json").read_text())
    ended = result["files_ended"]
    assert {"s1-eth1.pcap", "dispatcher.record"} <= set(ended)
    assert f"not whole {', '.join(ended)}: " in " ".join(done.stdout.split())
    assert "s1-eth1.pcap has 1e-05 GiB: no more is captured there (--file-gib)" in done.stderr
    for name in ended[:-1]:
        assert (folder / name).stat().st_size >= 1e-05 * 2**30
        subprocess.run(
            ["tcpdump", "-r", folder / name], check=True, capture_output=True, timeout=SOON_S
        )
    assert re.match(
        r"identical: \d+ events of \d+ requests\nthe record ends there",
        verb("replay", str(folder)).stdout,
    )


def test_the_captures_hold_the_metadata_and_the_traffic_to_ed(
    short_run: tuple[Path, dict[str, Any]],
) -> None:
    _folder, result = short_run
    assert len(result["captures"]) == 6
    assert result["packets_not_captured"] == 0
    verdicts: dict[str, set[int]] = {}
    to_dispatcher = 0
    for capture in result["captures"]:
        with PcapReader(capture) as packets:
            for packet in packets:
                if TCP not in packet:
                    continue
                to_dispatcher += packet[IP].dst == "10.0.0.4" and packet[TCP].dport == 50051
                setup = setup_in(packet)
                if setup and packet[IP].dst == "10.0.0.2":
                    verdicts.setdefault(Path(capture).stem, set()).add(setup.verdict)
    # alice hangs on s1-eth1 and bob on s1-eth2: pending before the controller, granted behind it;
    # q1, on s1-eth5, gets a copy of what alice sent.
    assert verdicts == {
        "s1-eth1": {Verdict.PENDING},
        "s1-eth2": {Verdict.GRANTED},
        "s1-eth5": {Verdict.PENDING},
    }
    assert to_dispatcher > 10


def setup_in(packet: Any) -> Setup | None:
    """Return the set-up message that a packet carries, None if it carries none."""
    payload = bytes(packet[TCP].payload)[:SETUP_LENGTH]
    if packet[TCP].dport != METADATA_PORT or not payload:
        return None
    try:
        message = decode(payload)
    except MalformedPacket:
        return None
    return message if isinstance(message, Setup) else None


def test_the_event_log_is_on_the_clock_of_the_timeline(
    short_run: tuple[Path, dict[str, Any]],
) -> None:
    folder, result = short_run
    log = (folder / "quantum.log").read_text().splitlines()
    measured = [line.split()[0] for line in log if "bell-measure" in line]
    assert len(measured) == 1
    with Path(result["timeline"]).open("rb") as file:
        times = [packet.time_ns for packet in Reader(file).packets()]
    moment_ns = np.datetime64(measured[0].rstrip("Z"), "ns").astype(int)
    assert times[0] < moment_ns < times[-1]


LOSSY = ["--message", "x" * 500, "--loss-db-per-km", "50", "--depolarizing", "0.0005"]
LOSSY += ["--frame-bytes", "32", "--seed", "7"]


@pytest.fixture(scope="module")
def lossy_result(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the result of a run with losses and errors."""
    return run(tmp_path_factory.mktemp("runs"), *LOSSY)


@pytest.mark.nightly
def test_every_backend_gives_the_same_losses_and_errors(
    tmp_path: Path, lossy_result: dict[str, Any]
) -> None:
    others = [run(tmp_path, *LOSSY, "--backend", name) for name in ("stim", "dense")]
    results = [lossy_result, *others]
    assert [result["backend"] for result in results] == ["chp", "stim", "dense"]
    sent = [result["job"]["asking"] for result in results]
    assert sent[0]["lost_pairs"] > 0
    for name in ("lost_pairs", "symbol_error_rate", "repeated_frames"):
        assert len({each[name] for each in sent}) == 1
    for name in ("photons_lost", "exact"):
        assert len({result[name] for result in results}) == 1


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_losses(tmp_path: Path, lossy_result: dict[str, Any]) -> None:
    again = run(tmp_path, *LOSSY)
    assert again["job"]["asking"]["lost_pairs"] == lossy_result["job"]["asking"]["lost_pairs"] > 0
