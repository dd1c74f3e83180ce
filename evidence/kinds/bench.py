"""Measure this machine; print numbers, and ratios to a baseline of the same run."""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from evidence.bench.controller_load import controller_benchmarks
from evidence.bench.live_pairs import BLOCK_PAIRS, cost_by_live_pairs
from evidence.bench.many_hosts import many_hosts_benchmarks
from evidence.bench.measurement import seconds_of
from evidence.bench.overhead import overhead_benchmarks
from evidence.bench.path_benchmarks import path_benchmarks
from evidence.bench.physical_layer import physical_layer_benchmarks
from evidence.bench.sabot_speed import sabot_speed
from evidence.bench.service_rates import (
    key_benchmarks,
    swap_benchmarks,
    teleport_benchmarks,
)
from evidence.bench.stepped_time import stepped_benchmarks
from evidence.networks.sweep_points import sweep_benchmarks
from hosts.client import blocking_session
from hosts.stack_socket import BYTES
from qmn.needs import Needs
from qmn.parser import Parser
from qmn.timeouts import MEASURE_TIMEOUT_S, RUN_TIMEOUT_S
from topologies.networks.network import Interrupted, Network, Signals
from topologies.networks.requirements import require_root
from topologies.sdc import SdcTopo
from topologies.system.processes import commands
from topologies.system.processes.programs import NetworkError, python
from topologies.system.processes.signals import interrupted_words
from topologies.system.runs.runtime import Runtime
from topologies.tree import LEAST_HOSTS, MOST_HOSTS

MEBIBYTE = 1 << 20
PAIRS_PER_BYTE = 4
BROADCAST = "10.0.0.255"
LIVE_PAIRS = [100, 1_000, 10_000, 100_000, 1_000_000]
PACKET_INS_PER_PAIR = 2  # the set-up message, and the end of its connection


def names() -> dict[str, str]:
    return {}  # they are measured together


def describe(parser: Parser) -> None:
    parser.description = __doc__
    parser.add_argument("--pairs", type=int, default=256, help="of the per-pair handshake (256)")
    parser.add_argument("--setups", type=int, default=500, help="light paths to set up (500)")
    text = "sizes of networks to start, 3 to 1024, with commas (4,16,64)"
    parser.add_argument("--hosts", type=sizes, default=(4, 16, 64), metavar="N,N", help=text)
    parser.set_defaults(call=call, needs=Needs.NETWORK)


def sizes(text: str) -> tuple[int, ...]:
    """Return sizes of networks; raise ArgumentTypeError for anything else."""
    numbers = text.split(",")
    if not all(word.isdecimal() and LEAST_HOSTS <= int(word) <= MOST_HOSTS for word in numbers):
        raise argparse.ArgumentTypeError(
            f"{text!r}: numbers of hosts are {LEAST_HOSTS} to {MOST_HOSTS}, as 4,16,64"
        )
    return tuple(map(int, numbers))


def call(arguments: argparse.Namespace) -> int:
    """Measure everything; a network that does not start is one line and a status."""
    try:
        require_root()
        with Signals() as signals, tempfile.TemporaryDirectory(prefix="qmn-bench-") as name:
            folder = Path(name)
            figures = chain(
                sabot_speed(),
                physical_layer_benchmarks(),
                overhead_benchmarks(folder, signals),
                stepped_benchmarks(folder, signals),
                sweep_benchmarks(folder, signals),
                run(folder, arguments.pairs, signals),
                key_benchmarks(folder, signals),
                teleport_benchmarks(folder, signals),
                swap_benchmarks(folder, signals),
                path_benchmarks(folder, arguments.setups, signals),
                controller_benchmarks(folder / "ryu", signals, "ryu"),
                controller_benchmarks(folder / "os-ken", signals, "os-ken"),
                many_hosts_benchmarks(folder, arguments.hosts, signals),
            )
            for what, text in figures:
                print(f"{what:<34}{text}", flush=True)
    except Interrupted as error:
        print(f"qmn: {interrupted_words(error)}", file=sys.stderr)
        return error.status
    except NetworkError as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    return 0


def run(folder: Path, pairs: int, signals: Signals) -> Iterator[tuple[str, str]]:
    yield "whole run, 1 KiB, native", f"{whole_run(folder):.1f} s"
    with Network(SdcTopo, Runtime(log_folder=folder / "network"), signals) as network:
        network.capture("s1")
        seconds = send(network, os.urandom(MEBIBYTE), "framed")
        yield "framed, 1 MiB", f"{MEBIBYTE * PAIRS_PER_BYTE / seconds:,.0f} Bell pairs/s"
        connect_s, packet_in_s = baseline(network, pairs)
        yield "baseline: TCP connect and close", f"{connect_s * 1e3:.3f} ms"
        yield "baseline: packet-in to packet-out", f"{packet_in_s * 1e3:.3f} ms"
        size = max(pairs // PAIRS_PER_BYTE, 1)
        seconds, pairs = send(network, os.urandom(size), "per-pair"), size * PAIRS_PER_BYTE
        for live, pair_s, state in cost_by_live_pairs(network.runtime, LIVE_PAIRS):
            cost = f"{pair_s * 1e6:.2f} us a pair in blocks of {BLOCK_PAIRS:,}"
            text = f"{cost}, {state:.1f} bytes of state a live pair"
            yield f"dispatcher, {live:,} live pairs", text
    each_s, baseline_s = seconds / pairs, connect_s + PACKET_INS_PER_PAIR * packet_in_s
    yield "per-pair", f"{1 / each_s:,.0f} Bell pairs/s, {each_s * 1e3:.3f} ms each"
    times = f"{each_s / baseline_s:.2f} times {baseline_s * 1e3:.3f} ms"
    yield "per-pair to its baseline", times


def whole_run(folder: Path) -> float:
    """Return the time of `qmn run sdc` with 1 KiB, from start to clean machine.

    It is the command that is measured, its imports included: so it is a process of its own.
    """
    file = folder / "kibibyte"
    file.write_bytes(os.urandom(1024))
    command = [python(), "-m", "qmn", "run", "sdc", "--file", str(file)]
    started = time.perf_counter()
    commands.run(*command, "--runs", str(folder / "runs"), timeout_s=RUN_TIMEOUT_S)
    return time.perf_counter() - started


def send(network: Network, data: bytes, handshake: str) -> float:
    """Return the time from the first byte to the verified last, connecting not counted."""
    options: dict[str, Any] = {"limit_s": MEASURE_TIMEOUT_S, "handshake": handshake}
    stacks = network.runtime.socket
    with blocking_session(stacks, BYTES, ("alice", "bob"), 7, **options) as session:
        session.results()
        started = time.perf_counter()
        session.sendall(data)
        session.end()
        return time.perf_counter() - started


def baseline(network: Network, count: int) -> tuple[float, float]:
    """Return the seconds of one TCP connect and of one packet-in, alice to bob."""
    bob = network.runtime.addresses["bob"]
    server = network.run_on(
        "bob", "baseline", [python(), "-m", "evidence.bench.baseline", "serve", bob]
    )
    server.wait_for("ready", MEASURE_TIMEOUT_S)
    connect_s = measure(network, "connects", count, bob)
    return connect_s, measure(network, "packet-ins", count, BROADCAST)


def measure(network: Network, what: str, count: int, address: str) -> float:
    command = [python(), "-m", "evidence.bench.baseline", what, str(count), address]
    program = network.run_on("alice", what, command)
    return seconds_of(network, program)
