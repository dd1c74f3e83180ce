"""The network as scripts see it, and `py` in `qmn cli` (docs/scripting.md).

with start("sdc", length_km=1.0) as network:
    print(network.send("alice", "bob", b"hello").bell_pairs)
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, TypedDict, Unpack

from programs.network_waits import NetworkWaits
from qmn.jobs import on_network
from qmn.jobs.adjustment import adjusted
from qmn.jobs.on_network import STANDING, Made
from qmn.network.checks import check_two_hosts
from qmn.options import BadInput
from qmn.requests.of_job import JOBS
from qmn.results.result import network_facts
from qmn.running.controller_console import ask
from qmn.running.dispatcher_calls import held_blocks, switch_conditions, switch_statistics
from qmn.scripting.exchange import Exchange, exchange, explained, opened
from qmn.scripting.job_result import JobResult
from qmn.scripting.light import FiberState, LightPath, fiber_state, light_path
from qmn.scripting.tables import SIMPLE, Row, TableOf, Tabular, drawn, row_of
from topologies.networks.network import Network
from topologies.nodes import QuantumHost
from wire.controller_lines import NewFacts
from wire.parameters.checks import remedy

PING_BYTES = 16
PART_BYTES = 1 << 16


class SendOptions(TypedDict, total=False):
    """How a message is sent; `qmn run --help` says what each means and what it is if absent."""

    handshake: str
    frame_bytes: int
    block_pairs: int
    rate_hz: int
    fec: str
    interleave: bool


@dataclass(frozen=True)
class Held(Tabular):
    """Photons of a block that a host holds."""

    session: str  # 16 hexadecimal digits
    number: int
    half: int
    photons: int
    place: str  # "memory", the port they wait at, or "" for at hand


@dataclass(frozen=True)
class HostState(Tabular):
    """A host: what the controller knows of its device, and the blocks it holds.

    The device is as the host has last reported it, the blocks are as they are: `state` says when.
    As a table a row for each block, behind the device's values; one if it holds none.
    """

    device: dict[str, Any]
    blocks: tuple[Held, ...]

    def rows(self) -> Sequence[Row]:
        """Return a row for each block, behind numbers and texts of the device."""
        device = {name: value for name, value in self.device.items() if isinstance(value, SIMPLE)}
        held = [row_of(block) for block in self.blocks] or [
            dict.fromkeys(field.name for field in fields(Held))
        ]
        return [{**device, **block} for block in held]


class QuantumNetwork(Network):
    """A running network; `net` is Mininet's object, `host("alice")` one of its hosts."""

    made: Made  # what jobs are checked against
    record: NewFacts  # of the controller
    jobs = 0  # that were done on it

    @property
    def quantum_hosts(self) -> list[str]:
        """Return the names of the hosts that have light."""
        return [host.name for host in self.net.hosts if isinstance(host, QuantumHost)]

    def run(self, job: str, **options: Any) -> JobResult:
        """Do a job of `qmn run`, as run("swap", count=500); return what its result.json has.

        Options are those of the command line, in Python's spelling. Raise BadInput for one that
        needs another network, TransferError if the job fails; the network goes on standing, with
        decays of memories as `device` and `switch` have named them last.
        """
        self.jobs += 1
        stands = adjusted(self, self.made.description, options)
        self.made = replace(self.made, description=stands)
        result = on_network.run(self, self.made, job, options, self.jobs, self.record)
        return JobResult(**vars(result))

    def __getattr__(self, name: str) -> Callable[..., JobResult]:
        """Return `run` of the job of that name, as network.teleport(count=500)."""
        if name not in JOBS and name not in STANDING:
            raise AttributeError(f"a network has no {name!r}, and there is no such job")
        return partial(self.run, name)

    def send(
        self, sender: str, receiver: str, data: bytes, **options: Unpack[SendOptions]
    ) -> Exchange:
        """Send bytes by superdense coding; return when the receiver has verified every one.

        Raise BadInput for hosts there are not, TransferError if the bytes did not arrive.
        """
        check_two_hosts(sender, receiver, self.quantum_hosts)
        if isinstance(data, str):
            raise BadInput(f"data {data!r} is text: send bytes, as b'hello' or data.encode()")
        return exchange(self, sender, receiver, [data], keep=True, **options)

    def ping(
        self, sender: str, receiver: str, count: int = 4, **options: Unpack[SendOptions]
    ) -> Iterator[Exchange]:
        """Yield `count` short messages, each with a session and light paths of its own."""
        for number in range(count):
            yield self.send(sender, receiver, number.to_bytes(PING_BYTES, "big"), **options)

    def iperf(
        self, sender: str, receiver: str, seconds: float = 3.0, **options: Unpack[SendOptions]
    ) -> Exchange:
        """Send for so long as fast as it goes; what is received is counted and not kept."""
        check_two_hosts(sender, receiver, self.quantum_hosts)

        def parts() -> Iterator[bytes]:
            deadline = time.monotonic() + seconds
            while time.monotonic() < deadline:
                yield bytes(PART_BYTES)

        return exchange(self, sender, receiver, parts(), keep=False, **options)

    def sleep(self, seconds: float) -> None:
        """Return after seconds of the network."""
        with NetworkWaits(self.runtime.time) as waits:
            waits.sleep(seconds)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the network as a report draws it."""
        from views.report.markup import STYLE
        from views.report.network_diagram import network_diagram  # matplotlib

        return drawn(network_diagram(network_facts(self), []), STYLE.read_text())

    def paths(self) -> TableOf[LightPath]:
        """Return the light paths that stand now."""
        return self._light_paths(ask("paths")["paths"])

    def trace(self, sender: str, receiver: str) -> TableOf[LightPath]:
        """Open a session that sends nothing, and return the light paths that it gets."""
        check_two_hosts(sender, receiver, self.quantum_hosts)
        before = {path["session"] for path in ask("paths")["paths"]}
        ends = sender, receiver
        with (
            explained(self, sender, receiver),
            opened(self.runtime.socket, ends, self.runtime.time),
        ):
            paths = [path for path in ask("paths")["paths"] if path["session"] not in before]
            mine = [path for path in paths if (path["from"], path["to"]) == ends]
            return self._light_paths(mine)

    def _light_paths(self, paths: list[dict[str, Any]]) -> TableOf[LightPath]:
        names = {number: name for name, number in self.runtime.datapath_ids.items()}
        conditions = switch_conditions(self)
        fibers = self.runtime.fibers
        return TableOf(light_path(path, fibers, names, conditions) for path in paths)

    def fibers(self) -> TableOf[FiberState]:
        """Return every fibre with its loss now, and what has passed it."""
        names = {number: name for name, number in self.runtime.datapath_ids.items()}
        up = {
            (names[int(fiber["dpid"], 16)], fiber["port"]): fiber["up"]
            for fiber in ask("paths")["fibers"]
        }
        statistics = switch_statistics(self)
        return TableOf(fiber_state(fiber, statistics, up) for fiber in self.runtime.fibers)

    def state(self, host: str) -> HostState:
        """Return the state of a host; raise BadInput if there is none of this name.

        Its blocks are those of this moment. Its device is as last reported to the controller, which
        asks once a second unless the policy says otherwise, counts of pairs, too: `heard_s_ago`
        says how long ago that was.
        """
        if host not in self.quantum_hosts:
            raise BadInput(f"unknown host {host!r}: {remedy(host, self.quantum_hosts)}")
        device = next(device for device in ask("devices") if device["name"] == host)
        blocks = (
            Held(
                f"{held.block.session:016x}",
                held.block.number,
                held.block.half,
                held.photons,
                "memory" if held.stored else held.port,
            )
            for held in held_blocks(self, host)
        )
        return HostState(device, tuple(blocks))
