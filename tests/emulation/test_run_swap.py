"""`qmn run swap` from outside: a chain of repeaters over the real components."""

import json
import time
from functools import partial
from math import exp, sqrt
from pathlib import Path
from typing import Any

import pytest
from conftest import verb
from fabric_scene import facts, running, served
from loaded import run_qmn

from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from topologies.networks.network import Network
from topologies.repeaters import RepeatersTopo
from wire.controller_lines import read_record


def run(runs: Path, *options: str) -> dict[str, Any]:
    """Run it to its end; return the result."""
    done = run_qmn("run", "swap", "--without", "report", "--runs", str(runs), *options)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((runs / "latest" / "result.json").read_text())
    return result


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("repeaters", [1, 6])
def test_pairs_come_by_way_of_repeaters(tmp_path: Path, repeaters: int) -> None:
    result = run(tmp_path, "--topology", f"repeaters,{repeaters}", "--count", "1000")
    assert result["delivered"] is True
    alice, bob = result["job"]["asking"], result["job"]["asked"]
    assert (alice["pairs"], alice["fidelity"]) == (bob["pairs"], bob["fidelity"]) == (1000, 1)
    assert bob["waited_ms"] > 0
    assert result["path_setup_ms"]["n"] == repeaters + 1  # a path for each link


def test_a_pair_source_host_with_two_fibres_can_be_the_repeater(shared_network: Network) -> None:
    told = served(shared_network, "swap", "alice", "bob", count=500)
    assert (told["pairs"], told["fidelity"]) == (500, 1)


def test_pairs_of_a_chain_that_stands_come_by_way_of_two_repeaters(chain_network: Network) -> None:
    before = len(facts(chain_network, "path_ready"))
    told = served(chain_network, "swap", "alice", "bob", count=500)
    assert (told["pairs"], told["fidelity"]) == (500, 1)
    assert len(facts(chain_network, "path_ready")) == before + 3  # a path for each link


def test_a_noisy_run_has_the_fidelity_of_its_waits_and_is_replayed(tmp_path: Path) -> None:
    words = ["--topology", "repeaters,3", "--count", "2000", "--sample", "0.5"]
    words += ["--loss-db-per-km", "50", "--depolarizing", "0.01", "--block-pairs", "2000"]
    words += [f"--device={node}.memory.t2_s=1" for node in ("alice", "r1", "r2", "r3", "bob")]
    result = run(tmp_path, *words)
    folder = tmp_path / "latest"
    (chain,) = [fact for fact in read_record(folder) if fact["event"] == "chain"]
    assert len(chain["nodes"]) == 5
    in_repeaters_ms = result["job"]["asked"]["repeaters_waited_ms"]
    assert len(in_repeaters_ms) == 3
    waited_s = 2 * (sum(in_repeaters_ms) + result["job"]["asked"]["waited_ms"]) / 1000
    # Her halves wait as long as bob's, and until they are measured.
    told = result["job"]["asking"]
    error = 5 * sqrt(3 * 0.25 / 4 * 3 / told["sampled"])
    assert fidelity(waited_s + 0.3) - error < told["fidelity"] < fidelity(waited_s) + error
    assert verb("replay", str(folder)).stdout.startswith("identical: ")


def fidelity(waited_s: float) -> float:
    """Return that of pairs of four links, of 0.99 a fibre, whose halves have waited; T2 is 1 s."""
    return (1 + 0.99**8 * (1 + 2 * exp(-waited_s))) / 4


def test_a_repeater_that_is_dead_is_named_to_the_one_who_asks(tmp_path: Path) -> None:
    with running(partial(RepeatersTopo, repeaters=2), tmp_path) as network:
        settings = network.runtime
        next(program for program in settings.programs if program.name == "r2").kill()
        sockets = (settings.socket("alice"), settings.socket("bob"))
        with ServiceSocket(sockets[0]) as asking, ServiceSocket(sockets[1]) as listener:
            listener.listen(9, "swap")
            asking.settimeout(10)
            started = time.monotonic()
            with pytest.raises(QuantumSocketError, match=r"r2 \(10.0.0.12\) has not answered"):
                list(asking.request("swap", ("bob", 9), count=100))
            assert time.monotonic() - started < 5
