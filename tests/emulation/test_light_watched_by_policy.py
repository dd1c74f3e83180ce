"""Idle light that the controller watches by itself, over real switches and hosts."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from conftest import wait_until
from fabric_scene import facts, running, session, switches_on_the_way
from loaded import run_qmn

from qmn.changes.fibers import adjust
from qmn.running.network import dispatcher_of_running_network
from topologies.networks.network import Network
from topologies.ring import RingTopo
from wire.dispatcher_pb2 import AdjustFiberRequest

DATA = bytes(range(256)) * 16
# One seal after the other, each for as long as nobody wants the light: 100 s of light.
POLICY = """
default = "deny"
[[rule]]
action = "allow"
service = "sdc"
[seal]
alarm = "close"
[[watch]]
between = ["charlie", "bob"]
over = ["q2", "q3"]
every_s = 0.2
pairs = 10_000_000
"""


def seen(network: Network, event: str, like: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Wait for a fact of the controller."""
    found: list[dict[str, Any]] = []

    def there() -> bool:
        found[:] = [fact for fact in facts(network, event) if like(fact)]
        return bool(found)

    wait_until(there, f"{event} is in the controller's record")
    return found[0]


def test_the_controller_watches_gives_back_closes_and_sends_light_another_way(
    tmp_path: Path,
) -> None:
    policy = tmp_path / "policy.toml"
    policy.write_text(POLICY)
    with running(partial(RingTopo, switches=4), tmp_path, policy=str(policy)) as network:
        first = seen(network, "watch", lambda _fact: True)
        assert first["detail"] == "charlie to bob over q2-q3"
        granted = seen(network, "granted", lambda fact: fact["session"] == first["session"])
        assert granted["time_ns"] > first["time_ns"]
        wait_until(
            lambda: switches_on_the_way(network, "charlie-q1") == ["q2", "q3", "bob"],
            "the seal has its light",
        )

        with session(network, "alice", "bob") as sending:  # whose pairs need both fibres of charlie
            wanted = seen(network, "wanted", lambda fact: fact["session"] == first["session"])
            mine = seen(network, "granted", lambda fact: fact["time_ns"] > wanted["time_ns"])
            assert mine["session"] != first["session"]
            assert sending.carry(DATA) == DATA
        report = seen(network, "watched", lambda fact: fact["session"] == first["session"])
        assert (report["end"], report["alarm"], report["watched"]) == ("BUSY", False, ["q2-q3"])
        assert report["errors"] == 0  # the fibres are ideal
        assert not facts(network, "forbidden")

        later = seen(network, "watch", lambda fact: fact["time_ns"] > mine["time_ns"])
        seen(network, "granted", lambda fact: fact["session"] == later["session"])
        tapped = AdjustFiberRequest(a="q2", b="q3", tapped=0.5)
        adjust(dispatcher_of_running_network(), tapped)
        alarm = seen(network, "alarm", lambda fact: fact["closed"])
        assert alarm["session"] == later["session"]
        assert alarm["watched"] == ["q2-q3"]

        with session(network, "alice", "bob") as sending:
            assert switches_on_the_way(network, "alice-q0") == ["q1", "q4", "q3", "bob"]
            assert sending.carry(DATA) == DATA
        assert len(facts(network, "alarm")) == 1


SLEEPING = """
import sys
from qmn.scripting import start
with start("sdc", policy=sys.argv[1], seed=3, folder=sys.argv[2]) as network:
    network.sleep(60)
"""
EACH_TEN_SECONDS = """
default = "allow"
[[watch]]
between = ["charlie", "bob"]
every_s = 10.0
pairs = 2000
rate_hz = 100_000
"""


def test_stepped_seals_come_as_often_as_the_policy_says(tmp_path: Path) -> None:
    """Each lasts for its blocks, of 10.23 ms: four or five, and the next is due 10 s later."""
    policy, script, folder = tmp_path / "policy.toml", tmp_path / "sleeping.py", tmp_path / "run"
    policy.write_text(EACH_TEN_SECONDS)
    script.write_text(SLEEPING)
    done = run_qmn("script", str(script), str(policy), str(folder))
    assert not done.returncode, done.stdout + done.stderr
    lines = map(json.loads, (folder / "controller.jsonl").read_text().splitlines())
    times: dict[str, list[int]] = {"watch": [], "torn_down": []}
    for line in lines:
        if line["event"] in times:
            times[line["event"]].append(line["time_ns"])
    assert len(times["watch"]) == 6  # from 0, 10.04, ... to 50.2 s
    for ended, begun in zip(times["torn_down"], times["watch"][1:], strict=False):
        assert begun - ended == 10_000_000_000
