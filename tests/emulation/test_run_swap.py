"""`qmn run swap` from outside: switches that swap, over the real components."""

import json
from concurrent.futures import ThreadPoolExecutor
from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S
from loaded import run_qmn
from test_switch_swaps import require_nothing_left

from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from topologies.networks.network import Network


def run(runs: Path, *options: str) -> dict[str, Any]:
    """Run it to its end; return the result."""
    done = run_qmn("run", "swap", "--without", "report", "--runs", str(runs), *options)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


@pytest.mark.parametrize(
    ("topology", "swaps"),
    [
        ("chain,6", 6),
        pytest.param("sdc", 1, marks=pytest.mark.nightly),
        pytest.param("ring,5", 3, marks=pytest.mark.nightly),
    ],
)
def test_pairs_come_by_way_of_switches(tmp_path: Path, topology: str, swaps: int) -> None:
    required = ("--metadata-at-switch", "required")  # every switch has seen the set-up itself
    result = run(tmp_path, "--topology", topology, "--count", "1000", *required)
    assert result["delivered"] is True
    alice, bob = result["job"]["asking"], result["job"]["asked"]
    assert (alice["pairs"], alice["fidelity"]) == (bob["pairs"], bob["fidelity"]) == (1000, 1)
    assert bob["waited_ms"] > 0
    assert len(bob["repeaters_waited_ms"]) == swaps
    assert result["path_setup_ms"]["n"] == 1


@pytest.mark.nightly
def test_analysers_of_linear_optics_join_half_of_the_pairs_each(tmp_path: Path) -> None:
    words = ["--topology", "chain,2", "--switch", "analysers=1", "--switch", "memories=2"]
    words += ["--switch", "sources=1", "--switch", "analyser.kind=linear", "--count", "2000"]
    alice = run(tmp_path, *words)["job"]["asking"]
    assert alice["fidelity"] == 1
    share, emitted = alice["shared"] / alice["emitted"], alice["emitted"]
    assert abs(share - 1 / 4) < 5 * sqrt(3 / 16 / emitted)


@pytest.mark.nightly
def test_the_pairs_of_a_chain_are_purified_until_they_are_as_good_as_is_asked(
    tmp_path: Path,
) -> None:
    """Of two links of .93 pairs have .8665, once purified by DEJMPS .8985: the first above .877."""
    words = ["--topology", "chain,1", "--count", "20000", "--sample", "0.5", "--fidelity", "0.877"]
    words += ["--device", "*.source.fidelity=0.93"]
    alice = run(tmp_path, *words)["job"]["asking"]
    assert (alice["rounds"], alice["pairs"]) == (1, 20_000)
    assert abs(alice["fidelity"] - 0.8985) < 5 * sqrt(9 / 16 / alice["sampled"])


def test_an_application_that_goes_in_mid_protocol_leaves_nothing_anywhere(
    chain_network: Network,
) -> None:
    sockets = chain_network.runtime.socket
    with ServiceSocket(sockets("bob")) as listener, ServiceSocket(sockets("alice")) as alice:
        listener.listen(9, "swap")
        wanted = {"count": 1_000_000, "block_pairs": 500, "swaps": 2}
        with ThreadPoolExecutor(1) as threads:
            accepting = threads.submit(listener.accept)
            next(alice.request("swap", ("bob", 9), **wanted))
            bob, _peer = accepting.result(SOON_S)
        alice.close()
        with bob, pytest.raises(QuantumSocketError):
            list(bob.results())
    require_nothing_left(chain_network)
