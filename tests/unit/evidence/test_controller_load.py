"""A controller whose switches are played: that it does what its benchmark counts."""

from collections import Counter
from pathlib import Path

import pytest

from evidence.bench.controller_load import AT_ONCE, controller_benchmarks
from topologies.networks.network import Signals
from wire.controller_lines import read_record


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("framework", ["ryu", "os-ken"])
def test_each_request_is_granted_or_refused_as_counted(tmp_path: Path, framework: str) -> None:
    folder, each = tmp_path / "played", 25
    with Signals() as signals:
        names = [
            name for name, _ in controller_benchmarks(folder, signals, framework, each * AT_ONCE)
        ]
    assert names == [f"{framework}, light granted", f"{framework}, light refused as BUSY"]
    events = Counter(fact["event"] for fact in read_record(folder))
    assert events["fiber"] == 2 * AT_ONCE
    assert events["path_ready"] == each * AT_ONCE + 1  # one stays while the others are refused
    assert events["refused"] == each * AT_ONCE
