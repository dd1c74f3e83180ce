"""Keys over a real network: the same at both ends, refused above the threshold, kept if asked."""

import json
import re
import subprocess
from itertools import pairwise, product
from math import exp, sqrt
from pathlib import Path
from typing import Any

import pytest
from conftest import TSHARK, typed
from fabric_scene import NOISE, facts, served
from loaded import run_qmn
from scapy.utils import rdpcap
from test_results_fit_schema import require_schema

import views.dissection.scapy_layers  # noqa: F401 (binds the layers)
from applications.qkd.messages import Confirm, Proposal
from applications.qkd.scapy_keys import QKey, key_messages
from evidence.curves.relay_theory import diagonal, rectilinear
from hosts.stack_socket import QuantumSocketError
from topologies.networks.network import Network
from views.report.first_photons import first_steps
from views.report.run_facts import read_run

# That two correlated outcomes have passed together.
FIBERS = {"bb84": 2, "bbm92": 4, "e91": 4, "mdi": 4}


LIAR = Path(__file__).parents[2] / "docs" / "mdi" / "lying_relay.py"


def run_qkd(runs: Path, *words: str) -> tuple[subprocess.CompletedProcess[str], dict[str, Any]]:
    """Distribute keys; return the process, and the result."""
    done = run_qmn("run", "qkd", *words, "--without", "report", "--runs", str(runs))
    require_schema(runs / "latest")
    return done, json.loads((runs / "latest" / "result.json").read_text())


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """Return the folder, with `keys` in it, and the result of a run that keeps keys."""
    folder = tmp_path_factory.mktemp("kept")
    words = ("--depolarizing", "0.01", "--count", "20000", "--keys", str(folder / "keys"))
    done, result = run_qkd(folder, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder, result


@pytest.mark.parametrize("protocol", list(FIBERS))
def test_keys_are_the_same_in_the_stores_of_both_hosts(
    noisy_network: Network, protocol: str
) -> None:
    network = noisy_network
    stores = {each: Path(network.runtime.key_folder(each)) for each in ("alice", "bob")}
    earlier = {each for store in stores.values() for each in store.rglob("*-*")}
    report = served(network, protocol, "alice", "bob", count=100_000)
    qber = (1 - (1 - NOISE) ** FIBERS[protocol]) / 2
    assert abs(report["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / report["disclosed_bits"])
    assert report["sifted_bits"] >= 100_000
    assert 0 < report["key_fraction"] < report["key_fraction_limit"]
    for mine, theirs in (("first", "second"), ("second", "first")):
        ours, others = (
            {
                file.name: file.read_bytes()
                for file in (stores[one] / other / hand_out).iterdir()
                if file not in earlier
            }
            for one, other, hand_out in (("alice", "bob", mine), ("bob", "alice", theirs))
        )
        assert ours == others
        assert mine != "first" or len(ours[report["first_key_id"]]) == 32


def test_what_a_run_leaves_behind_tells_no_key(kept: tuple[Path, dict[str, Any]]) -> None:
    there, result = kept
    keys = there / "keys"
    (folder,) = keys.glob("alice/bob/first")
    key = (folder / result["job"]["asking"]["first_key_id"]).read_bytes()
    for file in (there / "latest").iterdir():
        content = file.read_bytes()
        assert key not in content
        assert key.hex().encode() not in content
    assert {path.stat().st_mode & 0o777 for path in keys.rglob("*") if path.is_dir()} == {0o700}


def test_what_the_hosts_say_of_keys_is_read_from_the_captures(
    kept: tuple[Path, dict[str, Any]],
) -> None:
    there, result = kept
    folder = there / "latest"
    for wanted, count in (("qkd.malformed || qmeta.malformed", 0), ('qkd.kind == "Confirm"', 1)):
        assert len(shown(folder, wanted)) == count, wanted
    texts = {host: said_of_keys(folder, host) for host in ("10.0.0.1", "10.0.0.2")}
    first, last = texts["10.0.0.1"][0], texts["10.0.0.2"][-1]
    assert (first.kind, last.kind) == (Proposal.KIND, Confirm.KIND)
    assert last.payload.length == result["job"]["asking"]["key_bits"]
    assert "max_qber" in typed("timeline.md", 1, folder)
    # A packet may hold two messages.
    numbers = shown(folder, "qkd.session", "-T", "fields", "-e", "qkd.sequence")
    assert len(",".join(numbers).split(",")) == sum(map(len, texts.values()))


def said_of_keys(folder: Path, address: str) -> list[QKey]:
    """Return what alice's link has seen a host say."""
    return key_messages(rdpcap(str(folder / "s1-eth1.pcap")), address)


def shown(folder: Path, wanted: str, *how: str) -> list[str]:
    """Return what tshark shows of the packets of a filter."""
    command = [*TSHARK, "-r", str(folder / "all.pcapng"), "-Y", wanted, *how]
    script = ["-X", f"lua_script:{folder / 'qmn.lua'}"]
    done = subprocess.run([*command, *script], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_above_the_threshold_the_run_fails_and_no_key_is_kept(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    words = ("--depolarizing", "0.3", "--count", "20000", "--keys", str(keys))
    done, result = run_qkd(tmp_path, *words)
    assert done.returncode == 1
    assert f"QBER {result['job']['asking']['qber']:.4f}" in done.stderr
    assert "at most 0.1000 is allowed: noise or an eavesdropper" in done.stderr
    assert "no key" not in done.stdout  # but once
    assert not result["delivered"]
    assert result["pairs_made"] == 0  # states are prepared, by BB84
    assert result["exact"] is True
    assert [path for path in keys.rglob("*") if path.is_file()] == []


@pytest.mark.nightly
@pytest.mark.parametrize("protocol", list(FIBERS))
def test_eve_on_the_fibre_causes_a_quarter_of_her_fraction_in_errors(
    tmp_path: Path, protocol: str
) -> None:
    fraction = 0.2
    words = ("--protocol", protocol, "--eve", str(fraction), "--count", "50000")
    done, result = run_qkd(tmp_path, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    report, eve = result["job"]["asking"], result["job"]["eve"]
    qber = fraction / 4
    assert abs(report["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / report["disclosed_bits"])
    assert eve["photons"] == report["photons"]
    spread = 5 * sqrt(eve["photons"] * fraction * (1 - fraction))
    assert abs(eve["measured"] - fraction * eve["photons"]) < spread


def test_s_of_e91_is_that_of_the_pairs_and_of_too_small_a_one_no_key_comes(
    noisy_network: Network,
) -> None:
    """S = 2 sqrt 2 (1 - p)^4, of four correlations; with a margin of .75 it gives no key."""
    s, report = 2 * sqrt(2) * (1 - NOISE) ** 4, re.compile(r"S is ([\d.]+) of (\d+) pairs")
    with pytest.raises(QuantumSocketError, match=report) as caught:
        served(noisy_network, "e91", "alice", "bob", count=20_000, chsh_margin=0.75)
    found = report.search(str(caught.value))
    assert found is not None
    assert abs(float(found[1]) - s) < 5 * sqrt(16 * (1 - (s / 4) ** 2) / int(found[2]))


@pytest.mark.nightly
def test_a_relay_that_lies_is_seen_as_noise_and_brings_no_key(tmp_path: Path) -> None:
    """Psi- for Psi+, of 30 %: of these bits of X are wrong, which are half."""
    share = 0.3
    liar = f"charlie.detectors.noise={LIAR}:Liar"
    words = ["--device", liar]
    words += ["--device", f'charlie.detectors.noise_parameters={{"share": {share}}}']
    done, result = run_qkd(tmp_path, "--protocol", "mdi", *words, "--count", "20000")
    assert done.returncode == 1
    assert "at most 0.1000 is allowed: noise or an eavesdropper" in done.stderr
    report, qber = result["job"]["asking"], share / 2
    assert abs(report["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / report["disclosed_bits"])
    assert report["key_bits"] == 0


@pytest.mark.nightly
def test_decoys_of_both_ends_make_a_key_by_a_relay(tmp_path: Path) -> None:
    """In Z no pulses alike are announced; of the others the closed form of both papers."""
    laser = ("statistics=poisson", "mean_pairs=0.4", "decoys=[0.1, 0.0]")
    words = [f"{host}.source.{each}" for host in ("alice", "bob") for each in laser]
    given = [part for word in words for part in ("--device", word)]
    bound = ("--bound", "asymptotic", "--count", "20000")
    done, result = run_qkd(tmp_path, "--protocol", "mdi", *given, *bound)
    assert done.returncode == 0, done.stdout + done.stderr
    report = result["job"]["asking"]
    means = list(zip((0.4, 0.1, 0.0), (0.5, 0.35, 0.15), strict=True))
    gain = sum(
        p * q * formula(a, b, 0.0, 0.0)[0]
        for formula in (rectilinear, diagonal)
        for (a, p), (b, q) in product(means, repeat=2)
    )
    expected = gain / 4 * report["photons"]
    assert abs(report["sifted_bits"] - expected) < 5 * sqrt(expected)
    assert report["qber"] == 0
    assert report["key_bits"] > 0
    assert report["intensities"] == [0.4, 0.1, 0.0]


@pytest.mark.nightly
def test_heralded_photons_come_as_their_pairs_and_unlike_detectors_tell_fewer_ones(
    tmp_path: Path,
) -> None:
    """Of thermal pairs n come with m^n / (1 + m)^(n + 1) (1 - (1 - e)^n); all of n = 1 to 39."""
    mean, herald, mismatch = 0.1, 0.6, 0.5
    source = [f"statistics=thermal,mean_pairs={mean},heralding_efficiency={herald}"]
    words = [f"alice.source.{word}" for word in source[0].split(",")]
    words.append(f"bob.detectors.efficiency_mismatch={mismatch}")
    given = [part for word in words for part in ("--device", word)]
    done, result = run_qkd(tmp_path, *given, "--count", "20000", "--bound", "asymptotic")
    assert done.returncode == 0, done.stdout + done.stderr
    report = result["job"]["asking"]
    likely = [mean**n / (1 + mean) ** (n + 1) * (1 - (1 - herald) ** n) for n in range(40)]
    several = sum(likely[2:])
    assert abs(report["multi_photon"] - several) < 1e-9
    zero, one = sum(likely), sum(p * (1 - mismatch**n) for n, p in enumerate(likely))
    # In the other basis photons of a pulse part: neither of both with a mean of .75^n.
    parted = sum(p * (1 - (1 - (2 - mismatch) / 2) ** n) for n, p in enumerate(likely))
    gain = (zero + one) / 4 + parted / 2
    assert abs(report["raw_bits"] - gain * report["photons"]) < 5 * sqrt(gain * report["photons"])
    ones = one / (zero + one)
    error = sqrt(ones * (1 - ones) / report["disclosed_bits"])
    assert abs(report["ones_fraction"] - ones) < 5 * error
    assert report["qber"] == 0


@pytest.mark.nightly
def test_if_eve_measures_everything_the_key_is_refused(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    done, result = run_qkd(tmp_path, "--eve", "1", "--count", "20000", "--keys", str(keys))
    assert done.returncode == 1
    assert "at most 0.1000 is allowed: noise or an eavesdropper" in done.stderr
    assert result["job"]["asking"]["qber"] > 0.2
    assert result["job"]["eve"]["measured"] == result["job"]["eve"]["photons"] > 0
    first = first_steps(read_run(tmp_path / "latest").events, ("alice", "bob"))
    assert [step.text for step in first] == ["alice sends", "eve reads", "bob measures"]
    for before, after in pairwise(first):  # equal bases give equal bits, others any
        photons = [*zip(before.bases, before.bits, after.bases, after.bits, strict=True)]
        assert len(photons) == 20
        assert all(bit == seen for basis, bit, other, seen in photons if basis == other)
    assert len({bit for step in first for bit in step.bits}) == 2
    assert [path for path in keys.rglob("*") if path.is_file()] == []


LASER = ("--device", "alice.source.statistics=poisson", "--device", "alice.source.mean_pairs=0.5")


@pytest.mark.nightly
def test_who_splits_photon_numbers_is_not_seen_and_leaves_no_key(tmp_path: Path) -> None:
    """Behind 8 dB 1 - exp(-.5 t) of the pulses are seen, fewer than have several photons."""
    hides_db = 8.0
    words = ("--eve", "1", "--eve-attack", "split", "--eve-hides-db", str(hides_db))
    done, result = run_qkd(tmp_path, *LASER, *words, "--count", "20000")
    assert done.returncode == 1
    assert "which an eavesdropper can divide" in done.stderr
    report, eve = result["job"]["asking"], result["job"]["eve"]
    gain = 1 - exp(-0.5 * 10 ** (-hides_db / 10))
    assert abs(report["raw_bits"] - gain * report["photons"]) < 5 * sqrt(gain * report["photons"])
    assert report["qber"] == 0
    several = 1 - 1.5 * exp(-0.5)
    assert abs(eve["multi_photon"] - several * eve["photons"]) < 5 * sqrt(several * eve["photons"])
    assert eve["photons"] == report["photons"]
    assert eve["multi_photon"] > report["raw_bits"]
    assert (eve["expected_db"], eve["onward_db"]) == (hides_db, 0.0)


@pytest.mark.nightly
def test_decoys_find_who_splits_photon_numbers(tmp_path: Path) -> None:
    """At 4 dB of single photons is .689 of the bits at least, and .533 with her (1311.7129)."""
    source = (*LASER, "--device", "alice.source.decoys=[0.1, 0.0]", "--bound", "asymptotic")
    words = ("--eve", "1", "--eve-attack", "split", "--eve-hides-db", "4", "--count", "60000")
    done, result = run_qkd(tmp_path, *source, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert abs(result["job"]["asking"]["single_photon_fraction"] - 0.533) < 0.05
    assert result["job"]["asking"]["qber"] == 0


def test_a_session_gets_the_light_of_one_that_has_just_ended(shared_network: Network) -> None:
    """Each carries so much that its close has to be held against what the switch counts."""
    network, bits = shared_network, 3_000_000
    before = len(facts(network, "torn_down"))
    for opener, acceptor in (("alice", "bob"), ("bob", "alice"), ("bob", "alice")):
        report = served(network, "bb84", opener, acceptor, count=bits)
        assert report["sifted_bits"] >= bits
    over = [fact["detail"] for fact in facts(network, "torn_down")[before:]]
    assert over[:2] == ["close", "close"]
