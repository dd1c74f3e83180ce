"""Conference keys: three hosts get the same ones, over fibres that depolarise."""

import re
from math import log2, sqrt
from pathlib import Path

from fabric_scene import NOISE, served
from loaded import run_qmn

from topologies.networks.network import Network

HOSTS = ("alice", "bob", "charlie")


def entropy(p: float) -> float:
    return -p * log2(p) - (1 - p) * log2(1 - p)


def keys_of(network: Network, host: str) -> dict[str, bytes]:
    """Return the keys of all three in the store of a host."""
    stored = Path(network.runtime.key_folder(host), "+".join(HOSTS)).glob("*/*-*")
    return {file.name: file.read_bytes() for file in stored}


def test_three_hosts_get_the_same_keys(noisy_network: Network) -> None:
    """Q = (1 - (1 - p)^4)/2 of two links of two fibres each, in X and of the last host in Z."""
    report = served(noisy_network, "conference", *HOSTS, line=",".join(HOSTS), count=15_000)
    expected = (1 - (1 - NOISE) ** 4) / 2
    for found, tests in ((report["qber_x"], "tests_in_x"), (report["qber_z"][1], "tests_in_z")):
        assert abs(found - expected) < 5 * sqrt(expected / report[tests])
    assert 0 < report["key_bits"] < report["raw_bits"] * (1 - 2 * entropy(expected))
    alice, *others = (keys_of(noisy_network, host) for host in HOSTS)
    assert len(alice) == report["keys"] == report["key_bits"] // 256
    assert all(each == alice for each in others)


def test_who_measures_in_the_first_link_is_found_and_there_is_no_key(tmp_path: Path) -> None:
    """In Z or X by chance: a quarter of the parities in X are odd, and of the bits in Z differ."""
    words = ["--eve", "1", "--count", "3000", "--captures", "none", "--without", "report"]
    done = run_qmn("run", "conference", *words, "--runs", str(tmp_path))
    assert done.returncode != 0
    report = re.search(
        r"of (\d+) tests of .* (\d+) are wrong .*eavesdropper", done.stdout + done.stderr
    )
    assert report is not None, done.stdout + done.stderr
    tests, wrong = map(int, report.groups())
    assert abs(wrong / tests - 0.25) < 5 * sqrt(0.1875 / tests)
