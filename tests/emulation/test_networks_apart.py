"""qmn apart: a network beside another one on the same machine."""

import os
import signal
import subprocess
from pathlib import Path

from conftest import ROOT, qmn, wait_until

from topologies.network import Network

QMN = str(ROOT / "bin" / "qmn")


def test_a_network_runs_beside_another_and_can_be_looked_at_and_ended(
    shared_network: Network, tmp_path: Path
) -> None:
    refused = qmn(runs=tmp_path / "refused")
    assert "qmn apart" in refused.stderr
    ours = subprocess.check_output(["ovs-vsctl", "list-br"])
    reader, writer = os.pipe()
    command = [QMN, "apart", "cli", "ring", "--switches", "3", "--runs", str(tmp_path)]
    process = subprocess.Popen(command, stdin=reader, stdout=subprocess.DEVNULL, cwd=ROOT)
    os.close(reader)

    def says(*words: str) -> subprocess.CompletedProcess[str]:
        enter = [QMN, "apart", "--of", str(process.pid), *words]
        return subprocess.run(enter, capture_output=True, text=True, check=False, timeout=30)

    try:
        wait_until(lambda: "q3" in says("devices").stdout, "its third switch is seen", 60)
        assert (
            "q3"
            not in subprocess.run(
                [QMN, "devices"], capture_output=True, text=True, check=True, timeout=30
            ).stdout
        )
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.wait()
        os.close(writer)
    assert "is not a `qmn apart` that runs" in says("devices").stderr
    shared_network.check()
    assert subprocess.check_output(["ovs-vsctl", "list-br"]) == ours
