"""The words of programs on one time line, whatever the clocks of their machines say."""

import json
import time
from pathlib import Path

import pytest

from applications.keys.time_series import TimeSeries
from topologies.system.processes.programs import Program
from wire.network_time import NetworkTime
from wire.results.time_series import AnyMoment


def test_times_of_another_machine_are_by_this_ones_clock(tmp_path: Path) -> None:
    """Bob's clock is 100 s ahead; what he says came between the two lines of alice."""
    programs = {host: Program(host, tmp_path / f"{host}.log") for host in ("alice", "bob")}
    for program in programs.values():
        program.log.touch()
    reports: list[AnyMoment] = []
    moments = TimeSeries(programs, NetworkTime(2.0, time.time_ns()), reports.append, {"bob": 100.0})
    now = time.time()
    texts = {"alice": [now + 2, now + 6], "bob": [now + 104]}
    for host, times in texts.items():
        lines = [json.dumps({"event": "tunnel_opened", "at": at}) for at in times]
        programs[host].log.write_text("\n".join(lines) + "\n")
    moments.gather()
    assert [each.host for each in reports] == ["alice", "bob", "alice"]
    assert [each.at for each in reports] == pytest.approx([1, 2, 3], abs=0.1)
