"""A fibre that is cut while its network starts."""

from pathlib import Path

import pytest
from fabric_scene import running

from topologies.networks.parallel import ParallelMininet
from topologies.sdc import SdcTopo
from topologies.system.processes.programs import NetworkError


def test_a_fibre_cut_before_it_was_found_is_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = ParallelMininet.start

    def start_cut(net: ParallelMininet) -> None:
        net.configLinkStatus("alice", "q1", "down")
        start(net)

    monkeypatch.setattr(ParallelMininet, "start", start_cut)
    words = r"alice-q0 at q1-eth\d was cut before the controller found it"
    with pytest.raises(NetworkError, match=words), running(SdcTopo, tmp_path):
        pass
