"""Prometheus on this machine reaches every program of a network, also the one on host ed."""

import json
import re
import urllib.request
from functools import partial
from pathlib import Path

import pytest
from conftest import qmn_words, wait_until
from loaded import running_qmn
from prometheus_client.parser import text_string_to_metric_families
from test_results_fit_schema import require_schema

from topologies.system.processes.programs import ROOT


def metrics(url: str) -> dict[str, float]:
    """Return the samples of a program: a sum over labels for each name."""
    with urllib.request.urlopen(url, timeout=10) as response:  # noqa: S310 (our own http)
        families = text_string_to_metric_families(response.read().decode())
    total: dict[str, float] = {}
    for sample in (sample for family in families for sample in family.samples):
        total[sample.name] = total.get(sample.name, 0.0) + sample.value
    return total


def counted(url: str, name: str) -> bool:
    return metrics(url).get(name, 0) > 0


def queried() -> set[str]:
    """Return the names of metrics in the queries of the dashboard."""
    board = json.loads((ROOT / "docs" / "metrics" / "grafana.json").read_text())
    queries = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    assert len(queries) > 12
    return set(re.findall(r"\bqmn_\w+", " ".join(queries)))


@pytest.mark.by_day(every=2)
@pytest.mark.waits
@pytest.mark.parametrize("controller", ["ryu", "os-ken"])
def test_a_run_tells_its_metrics_while_it_lasts(tmp_path: Path, controller: str) -> None:
    words = ["--metrics", "--controller", controller, "--message", "x" * 250]
    words += ["--rate-hz", "400", "--block-pairs", "200", "--frame-bytes", "8"]
    words += ["--loss-db-per-km", "10", "--depolarizing", "0.004"]
    with running_qmn(*qmn_words(tmp_path), *words, end_s=60) as run:
        targets = tmp_path / "latest" / "prometheus.json"
        wait_until(targets.exists, "targets for Prometheus")
        wait_until(lambda: "program" in targets.read_text(), "whole targets")
        found = {
            target["labels"]["program"]: f"http://{target['targets'][0]}/metrics"
            for target in json.loads(targets.read_text())
        }
        assert found.keys() == {"dispatcher", "q1-agent", "c0"}
        wait_until(lambda: metrics(found["dispatcher"])["qmn_pairs_created_total"] >= 400, "pairs")
        wait_until(lambda: metrics(found["dispatcher"])["qmn_live_qubits"] >= 100, "qubits")
        assert metrics(found["dispatcher"])["qmn_photons_lost_total"] > 0
        assert metrics(found["dispatcher"])["qmn_rpc_seconds_count"] > 2
        assert metrics(found["q1-agent"])["qmn_light_paths"] == 3
        assert metrics(found["c0"])["qmn_path_setup_seconds_count"] >= 1
        for name in ("pairs_made", "pairs_lost", "symbol_errors"):  # as hosts report them
            wait_until(partial(counted, found["c0"], f"qmn_{name}_total"), name)
        served = set().union(*(metrics(url) for url in found.values()))
        assert queried() - served <= {"qmn_hardware_refusals_total"}  # there is none yet
        output = run.finish(60)
    assert run.returncode == 0, output
    require_schema(tmp_path / "latest")
    for url in found.values():
        assert re.search(re.escape(url), output)
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    assert result["metrics"] == found
