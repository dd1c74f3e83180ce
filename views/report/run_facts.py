"""The facts of a run that its report reads from the folder."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qmn.results.run_result import NetworkResult, RunResult
from qmn.results.schema import of_either_kind, read_left
from qmn.running.network import left_of_killed
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from wire import typed_json
from wire.controller_lines import read_record
from wire.dispatcher_pb2 import Event
from wire.malformed import MalformedPacket
from wire.metadata.vocabulary import SYMBOLS
from wire.results.figures import KeyProgress, ReceiverFigures, SentFigures
from wire.results.run_result import RESULT, NetworkFacts, ServiceJob
from wire.results.time_series import fields_of, figures

SENDER_LOG = "asking.log"
MOST_COUNT = 1 << 53  # of symbols: what is divided exactly
LINK_NAMES = 4  # of copper: node and interface at either end
TELLING = ("result", "done")  # events that tell figures


class BadRun(Exception):
    """A folder that no report can be made of; the text names it and the remedy."""


@dataclass(frozen=True)
class RunFacts:
    folder: Path
    result: RunResult
    network: NetworkFacts
    events: list[Event]  # of blocks, not of single photons
    setup_ms: list[float]  # of every light path
    sender: list[SentFigures | KeyProgress]  # lines of the asking application

    @property
    def confusion(self) -> NDArray[np.int64] | None:
        """How often each symbol sent (row) was received as which (column), of frames delivered.

        None if the receiver did not come to say it. Raise BadRun unless it is a table of counts.
        """
        job = self.result.job
        if not (isinstance(job, ServiceJob) and isinstance(job.asked, ReceiverFigures)):
            return None
        rows = job.asked.confusion
        counts = all(0 <= count < MOST_COUNT for row in rows for count in row)
        lengths = {len(rows), *map(len, rows)}
        if not counts or lengths != {max(SYMBOLS)}:
            raise BadRun(f"{self.folder / RESULT}: confusion must be a table of counts: {rows}")
        return np.array(rows, dtype=np.int64)


def read_run(folder: Path) -> RunFacts:
    """Read a run; raise BadRun for a folder without, MalformedPacket for a spoiled capture."""
    result, network = read_result(folder)
    if not isinstance(result, RunResult):
        raise BadRun(f"{folder} is of `qmn cli` or a script: only `qmn run` has a report")
    if not result.hosts or result.hosts[0] not in network.addresses:
        raise BadRun(f"{folder / RESULT}: hosts {result.hosts} are not of its network")
    # A memory of a switch may keep qubits for ever: that is not drawn.
    losses = [[switch.insertion_loss_db, switch.paths] for switch in network.switches]
    drawn: list[object] = [network.fibers, network.positions, losses]
    drawn += [result.time_scale, result.settings.loss_budget_db]
    tells = result.message or isinstance(result.asking, KeyProgress)
    sender = _sender_lines(folder / SENDER_LOG) if tells else []
    drawn += sender
    job = vars(result.job)
    if not all(map(isfinite, _floats([*drawn, job.get("time_series"), job.get("load")]))):
        raise BadRun(f"{folder / RESULT}: a number to be drawn is infinite, or NaN")
    capture = folder / EVENT_CAPTURE
    events = recorded(capture, follow=False) if capture.exists() else iter(())
    return RunFacts(
        folder.resolve(),
        result,
        network,
        [event for event in events if not event.photon],
        _setup_ms(read_record(folder)),
        sender,
    )


def _floats(value: Any) -> Iterator[float]:
    if isinstance(value, float):
        yield value
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _floats(each)
    elif isinstance(value, dict) or hasattr(value, "__dict__"):
        yield from _floats([*(value if isinstance(value, dict) else vars(value)).values()])


def read_result(folder: Path) -> tuple[NetworkResult, NetworkFacts]:
    """Return what a run or a network has left as its result, and the network; raise BadRun."""
    try:
        killed = left_of_killed(folder)
        result = of_either_kind(killed) if killed else read_left(folder)
    except OSError as error:
        text = "name the folder of a run that has ended, as runs/latest"
        raise BadRun(f"cannot read {error.filename}: {error.strerror}; {text}") from error
    except MalformedPacket as error:
        raise BadRun(
            f"{folder / RESULT} does not say what the network was ({error}): it did not start, or "
            "another version made the run"
        ) from error
    if result.network is None:
        raise BadRun(f"the network of {folder} had not started: {result.error}")
    _check(result.network, folder)
    return result, result.network


def _check(network: NetworkFacts, folder: Path) -> None:
    """Raise BadRun for a network that cannot have been: of another person's run."""
    nodes = {*network.addresses, *(switch.name for switch in network.switches)}
    nodes |= {name for link in network.copper for name in link[::2]}
    ends = {end.node for fiber in network.fibers for end in (fiber.a, fiber.b)}
    if not nodes or ends - nodes or any(len(link) != LINK_NAMES for link in network.copper):
        raise BadRun(
            f"{folder / RESULT}: its network has no nodes, fibres to no node "
            f"({', '.join(sorted(ends - nodes))}), or copper without two ends"
        )


def _setup_ms(facts: list[dict[str, Any]]) -> list[float]:
    """Return how long the set-up of each light path took; raise MalformedPacket for no number."""
    setup_ms = [fact.get("setup_ms") for fact in facts if fact["event"] == "path_ready"]
    return typed_json.read(list[float], setup_ms, "setup_ms of light paths")


def _sender_lines(file: Path) -> list[SentFigures | KeyProgress]:
    """Return how far the sender was, line by line; nothing if there is no log."""
    lines = file.read_text(errors="replace").splitlines() if file.exists() else []
    reports = (figures(line) for line in map(fields_of, lines) if line.get("event") in TELLING)
    return [report for report in reports if isinstance(report, SentFigures | KeyProgress)]
