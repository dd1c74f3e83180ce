"""The time to set up a light path, from the metadata's packet-in on, and its baselines."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from evidence.bench.measurement import Times, finish, seconds_of
from qmn.timeouts import BASELINE_READY_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.open_vswitch import openvswitch
from topologies.system.processes.programs import NetworkError, Program, python
from topologies.system.runs.runtime import free_port
from wire.controller_lines import read_record

BRIDGE = "qmn-baseline"


@dataclass(frozen=True)
class Baseline:
    """A measurement of evidence.bench.baseline_app."""

    what: str  # learning, bundle or full
    count: int
    period_s: float = 0.0  # from turn to turn at least
    ports: int = 0


def path_setups(network: Network, count: int) -> Times:
    """Have alice ask for paths to bob, one after the other, each closed before the next."""
    runtime = network.runtime
    before = len(read_record(runtime.logs))
    command = [python(), "-m", "evidence.bench.path_requests", str(count)]
    command += [runtime.addresses["bob"], runtime.addresses[runtime.source]]
    command += [str(runtime.logs / "quantum.log")]
    seconds = seconds_of(network, network.run_on("alice", "path-requests", command))
    facts = read_record(runtime.logs)[before:]
    ready = [float(fact["setup_ms"]) for fact in facts if fact["event"] == "path_ready"]
    refused = sum(fact["event"] == "refused" for fact in facts)
    if len(ready) != count or refused:
        raise NetworkError(
            f"{len(ready)} paths were set up and {refused} refused, not {count} and 0; "
            "end what else uses this network"
        )
    return Times(ready, seconds)


def baseline_times(network: Network, baseline: Baseline) -> Times:
    """Time a bare bridge of Open vSwitch under the framework that c0 uses."""
    port = free_port()
    program = start_baseline(network, baseline, port)
    with bare_bridge(port):
        return times_of(network, program)


def start_baseline(network: Network, baseline: Baseline, port: int) -> Program:
    """Start the controller that measures, and wait until switches can connect."""
    command = [
        python(),
        "-m",
        "evidence.bench.path_baseline",
        network.runtime.settings.controller,
        f"127.0.0.1:{port}",
    ]
    command += [baseline.what, str(baseline.count)]
    command += ["--ports", str(baseline.ports), "--period-s", str(baseline.period_s)]
    program = network.run_beside(f"baseline-{baseline.what}-{port}", command)
    program.wait_for("ready", BASELINE_READY_TIMEOUT_S)
    return program


def times_of(network: Network, program: Program) -> Times:
    """Wait for what a baseline has measured."""
    each_ms = json.loads(finish(network, program))
    return Times(each_ms, sum(each_ms) / 1e3)


@contextmanager
def bare_bridge(port: int) -> Iterator[None]:
    """A bridge without ports and without agent, of ours, for a controller at this port."""
    if BRIDGE in openvswitch.bridges():
        raise NetworkError(
            f"bridge {BRIDGE} exists already; remove it with `ovs-vsctl del-br {BRIDGE}`"
        )
    try:
        openvswitch.add(BRIDGE, f"tcp:127.0.0.1:{port}")
        yield
    finally:
        openvswitch.delete(BRIDGE)
