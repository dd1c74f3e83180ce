"""The controller, as a program of its own on each framework, tells Prometheus its metrics."""

import os
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from limits import SOON_S
from prometheus_client.parser import text_string_to_metric_families

from wire.config import ControllerConfig

RECORDED = """
from prometheus_client import CollectorRegistry, generate_latest
from controller_apps.console.metrics import MeasuredRecord
registry = CollectorRegistry()
record = MeasuredRecord("", registry)
record.write("path_ready", session="1", setup_ms=2.5)
record.write("refused", session="2")
print(generate_latest(registry).decode())
"""


@pytest.mark.parametrize("framework", ["ryu", "os-ken"])
def test_a_controller_answers_beside_its_work(tmp_path: Path, framework: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = listener.getsockname()
        config = ControllerConfig(
            listen=f"127.0.0.1:{port}", framework=framework, metrics_fd=listener.fileno()
        )
        config.write(tmp_path / "c0.json")
        program = subprocess.Popen(
            [sys.executable, "-m", "controller_apps", "--config", str(tmp_path / "c0.json")],
            stdout=subprocess.PIPE,
            text=True,
            pass_fds=[listener.fileno()],
        )
    with program:
        try:
            assert program.stdout
            assert program.stdout.readline() == "ready\n"
            socket.create_connection(address).close()  # says nothing: the next is answered
            for _ in range(2):
                url = f"http://{address[0]}:{address[1]}/metrics"
                with urllib.request.urlopen(url, timeout=SOON_S) as response:
                    families = list(text_string_to_metric_families(response.read().decode()))
            names = {family.name for family in families}
            assert {"qmn_path_setup_seconds", "qmn_symbol_errors", "qmn_packet_ins"} <= names
        finally:
            program.terminate()
            program.wait(SOON_S)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("framework", ["ryu", "os-ken"])
def test_recorded_facts_are_counted_and_set_ups_timed(framework: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", RECORDED],
        env={**os.environ, "QMN_CONTROLLER_FRAMEWORK": framework},
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=True,
    )
    families = text_string_to_metric_families(done.stdout)
    samples = {(s.name, *s.labels.values()): s.value for f in families for s in f.samples}
    assert samples["qmn_controller_facts_total", "refused"] == 1
    assert samples[("qmn_path_setup_seconds_count",)] == 1
    assert samples["qmn_path_setup_seconds_bucket", "0.005"] == 1
    assert samples["qmn_path_setup_seconds_bucket", "0.002"] == 0
