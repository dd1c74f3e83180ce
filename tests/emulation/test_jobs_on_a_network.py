"""Jobs that a script does, one after the other, on a network that goes on standing."""

from math import exp, inf, sqrt
from pathlib import Path
from typing import Any

import pytest
from test_results_fit_schema import require_schema

from applications.ghz.service import GhzFigures
from qmn.jobs.counted_service import PARTS
from qmn.network.custom_topology import BadTopology
from qmn.options import BadInput
from qmn.results.run_result import RunResult
from qmn.scripting import run, start, start_for
from topologies.system.processes.programs import NetworkError
from wire.results.figures import (
    KeyFigures,
    PairFigures,
    StoredKeyFigures,
    TeleportFigures,
)
from wire.results.run_result import NetqasmJob, ServiceJob

SIGMAS = 5


def asked(result: RunResult) -> PairFigures:
    """Return the figures of the host that was asked for pairs."""
    assert isinstance(result.job, ServiceJob)
    assert isinstance(result.job.asked, PairFigures)
    return result.job.asked


def test_pairs_of_two_swaps_dephase_by_the_sum_of_their_waits(tmp_path: Path) -> None:
    """The sum is that of docs/swapping.md; T2 is the same of all memories, and T1 endless."""
    t2_s = 0.003
    memories = [f"{host}.memory.t2_s={t2_s}" for host in ("alice", "bob")]
    parts = [*PARTS, f"memory.t2_s={t2_s}"]
    wanted = {"count": 3000, "sample": 0.5}
    with start_for(
        "swap", tmp_path, switches=2, length_km=10, device=memories, switch=parts
    ) as network:
        first = network.run("swap", **wanted)
        network.send("alice", "bob", b"of no job")
        second = network.run("swap", switches=2, **wanted)
    for result in (first, second):
        figures = asked(result)
        assert (result.delivered, figures.pairs, result.sessions.granted) == (True, 3000, 1)
        assert figures.repeaters_waited_ms is not None
        assert figures.waited_ms is not None
        waits_s = 2 * (sum(figures.repeaters_waited_ms) + figures.waited_ms) / 1000
        expected = (1 + exp(-waits_s / t2_s)) / 2
        assert 0.6 < expected < 0.95
        error = SIGMAS * sqrt(3 * 0.25 / figures.sampled)  # three bases share the sample
        assert figures.fidelity is not None
        assert abs(figures.fidelity - expected) < error
    assert second.pairs_made == first.pairs_made  # of a job alone, not of all so far
    assert (tmp_path / "2-swap" / "result.json").is_file()
    assert second.rows()[0]["switches"] == 2


@pytest.mark.parametrize("option", ["device", "switch"])
def test_memories_that_are_adjusted_are_those_of_a_network_started_so(option: str) -> None:
    """All figures are equal, also what hosts expect; with the T2 of the start they are others."""
    job: dict[str, Any] = {"count": 300, "sample": 0.5}

    def figures(t2_s: float, then_s: float) -> tuple[PairFigures, list[float]]:
        place = "alice." * (option == "device")
        words: dict[float, Any] = {each: [f"{place}memory.t2_s={each}"] for each in (t2_s, then_s)}
        with start_for(
            "swap", switches=1, length_km=10, seed=3, **job, **{option: words[t2_s]}
        ) as network:
            result = network.run("swap", **job, **{option: words[then_s]})
            again = network.run("swap", **job)  # goes on so
            with pytest.raises(BadTopology, match=r"t2_s 0.0: choose 1e-12 or more"):
                network.run("swap", **job, **{option: [f"{place}memory.t2_s=0"]})
            with pytest.raises(BadInput, match="fixed when a network starts"):
                network.run("swap", **job, **{option: [f"{place}memory.capacity=900"]})
        assert isinstance(again.asking, PairFigures)
        assert result.network is not None
        of_switches = [switch.memory.t2_s for switch in result.network.switches]
        assert isinstance(result.asking, PairFigures)
        return result.asking, of_switches

    started, adjusted, others = figures(2e-3, 2e-3), figures(1.0, 2e-3), figures(1.0, 1.0)
    assert vars(adjusted[0]) == vars(started[0])
    assert adjusted[1] == started[1] == [2e-3 if option == "switch" else inf]
    assert adjusted[0].fidelity != others[0].fidelity
    if option == "device":
        assert adjusted[0].fidelity_expected != others[0].fidelity_expected


def test_all_kinds_of_jobs_follow_each_other_and_impossible_ones_are_refused() -> None:
    with start("sdc") as network:
        assert network.run("sdc", message="hello").delivered
        teleported = network.teleport(count=500).asking
        assert isinstance(teleported, TeleportFigures)
        assert teleported.fidelity == 1
        states = network.run("ghz", line="alice,bob,charlie", count=100).asking
        assert isinstance(states, GhzFigures)
        assert states.fidelity == 1
        for job, options, why in (
            ("swpa", {}, "did you mean swap"),
            ("swap", {"cuont": 1}, "did you mean count"),
            ("teleport", {"eve": 0.1}, "no effect on teleport"),
            ("teleport", {"captures": "none"}, "of `qmn run`"),
            ("teleport", {"length_km": 5.0}, r"start_for\('teleport', length_km=5.0\)"),
            ("qkd", {"eve": 0.1}, r"start_for\('qkd', eve=0.1\)"),
            ("qkd", {"protocol": "mdi"}, r"start_for\('qkd', protocol='mdi'\)"),
            ("qkd", {"protocol": "mid"}, "did you mean mdi"),
            ("swap", {"purify": 1}, "analyser between them: choose --topology chain,3"),
        ):
            with pytest.raises(BadInput, match=why):
                network.run(job, **options)
        assert network.run("distribute", count=200).delivered


ALONE = """
from netqasm.sdk import Qubit
from netqasm.sdk.external import NetQASMConnection

def main(app_config=None, flips=0):
    with NetQASMConnection("alice") as unit:
        qubit = Qubit(unit)
        for _ in range(flips):
            qubit.X()
        return qubit.measure()
"""


def test_programs_follow_each_other_on_a_network_beside_other_jobs(tmp_path: Path) -> None:
    """X^n |0> is found as n mod 2."""
    (tmp_path / "app_alice.py").write_text(ALONE)
    with start("sdc", tmp_path / "left") as network:
        for flips in (1, 2):
            given = [f"alice.flips={flips}"]
            result = network.netqasm(path=tmp_path, input=given, rounds=3)
            assert isinstance(result.job, NetqasmJob)
            assert result.job.outputs == [{"alice": flips % 2}] * 3
            assert (result.delivered, result.hosts) == (True, ["alice"])
        assert network.run("distribute", count=200).delivered
        for options, why in (
            ({}, "say which application: path="),
            ({"path": tmp_path, "round": 1}, "there is no option round: did you mean rounds"),
            ({"path": "/nowhere"}, "there is no /nowhere"),
            ({"path": tmp_path, "input": ["alice.x=1"]}, "has no such parameter"),
        ):
            with pytest.raises(BadInput, match=why):
                network.run("netqasm", **options)
    require_schema(tmp_path / "left")
    require_schema(tmp_path / "left" / "2-netqasm")


def test_eve_takes_another_fraction_of_the_light_of_each_job() -> None:
    """Intercept and resend makes an error rate of a quarter of her fraction."""
    with start_for("qkd", eve=0) as network:
        for fraction in (0.0, 0.2, 0.6):
            result = network.run("qkd", eve=fraction, count=4000)
            figures = result.asking
            assert isinstance(figures, KeyFigures)
            assert figures.qber is not None
            least = 300  # bits that are compared for the test, if no key can be
            error = SIGMAS * sqrt(fraction / 4 * (1 - fraction / 4) / least)
            assert abs(figures.qber - fraction / 4) <= error
        assert result.delivered is False
        assert result.error is not None
        assert result.error.startswith("no key: ")
        with pytest.raises(BadInput, match="eve=0"):
            network.run("qkd", count=1000)


def test_jobs_with_networks_of_their_own_are_calls(tmp_path: Path) -> None:
    result = run("keys", seconds=2, captures="none", seed=4, folder=tmp_path)
    assert isinstance(result.asking, StoredKeyFigures)
    assert (result.delivered, result.seed, result.asking.elapsed_s) == (True, 4, 2.0)
    assert result.asking.keys > 0
    assert result.rows()[0]["keys"] == result.asking.keys
    (left,) = (path for path in tmp_path.iterdir() if not path.is_symlink())
    assert (left / "result.json").is_file()
    with pytest.raises(BadInput, match=r"keys: there is no --secnds"):
        run("keys", secnds=3)
    with pytest.raises(NetworkError, match="vpn: the file was not there in 1 s"):
        run("vpn", seconds=1, captures="none")
