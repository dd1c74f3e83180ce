"""The facts of a run that its report reads from the folder."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from qmn.live.event_sources import recorded
from qmn.live.running import left_of_killed
from qmn.results import schema
from qmn.results.run_result import NetworkResult, RunResult
from topologies.system.runs.runtime import EVENT_CAPTURE
from wire.application_lines import fields_of, figures
from wire.controller_lines import read_record
from wire.dispatcher_pb2 import Event
from wire.results.figures import ReceiverFigures, SentFigures
from wire.results.network_facts import NetworkFacts
from wire.results.run_result import RESULT, ServiceJob

SENDER_LOG = "asking.log"
TELLING = ("result", "done")  # events that tell figures


class BadRun(Exception):
    """A folder that no report can be made of; the text names it and the remedy."""


@dataclass(frozen=True)
class RunFacts:
    """A finished run."""

    folder: Path
    result: RunResult
    network: NetworkFacts
    events: list[Event]  # of blocks, not of single photons
    setup_ms: list[float]  # of every light path
    sender: list[SentFigures]  # what the sending application said, line by line

    @property
    def confusion(self) -> NDArray[np.int64] | None:
        """How often each symbol sent (row) was received as which (column), of frames delivered.

        None if the receiver did not come to say it.
        """
        job = self.result.job
        if not (isinstance(job, ServiceJob) and isinstance(job.asked, ReceiverFigures)):
            return None
        return np.array(job.asked.confusion, dtype=np.int64)


def read_run(folder: Path) -> RunFacts:
    """Read a run; raise BadRun for a folder without, MalformedPacket for a spoiled capture."""
    result, network = read_result(folder)
    if not isinstance(result, RunResult):
        raise BadRun(f"{folder} is of `qmn cli` or a script: only `qmn run` has a report")
    capture = folder / EVENT_CAPTURE
    events = recorded(capture, follow=False) if capture.exists() else iter(())
    return RunFacts(
        folder.resolve(),
        result,
        network,
        [event for event in events if not event.photon],
        [line["setup_ms"] for line in read_record(folder) if line["event"] == "path_ready"],
        _said(folder / SENDER_LOG) if result.message else [],
    )


def read_result(folder: Path) -> tuple[NetworkResult, NetworkFacts]:
    """Return what a run or a network has left as its result, and the network; raise BadRun."""
    try:
        killed = left_of_killed(folder)
        result = schema.of_either_kind(killed) if killed else schema.read_left(folder)
    except OSError as error:
        text = "name the folder of a run that has ended, as runs/latest"
        raise BadRun(f"cannot read {error.filename}: {error.strerror}; {text}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise BadRun(
            f"{folder / RESULT} does not say what the network was ({error}): it did not start, or "
            "another version made the run"
        ) from error
    if result.network is None:
        raise BadRun(f"the network of {folder} had not started: {result.error}")
    return result, result.network


def _said(file: Path) -> list[SentFigures]:
    """Return how far the sender was, line by line; nothing if there is no log."""
    lines = file.read_text(errors="replace").splitlines() if file.exists() else []
    told = (figures(line) for line in map(fields_of, lines) if line.get("event") in TELLING)
    return [each for each in told if isinstance(each, SentFigures)]
