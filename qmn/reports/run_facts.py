"""The facts of a run that its report reads from the folder."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qmn.live.event_sources import RESULT, recorded
from qmn.results.network_facts import NetworkFacts
from qmn.results.result import carries_bytes
from topologies.system.runs.runtime import EVENT_CAPTURE
from wire.application_lines import fields_of
from wire.controller_lines import read_record
from wire.dispatcher_pb2 import Event

SENDER_LOG = "asking.log"


class BadRun(Exception):
    """A folder that no report can be made of; the text names it and the remedy."""


@dataclass(frozen=True)
class RunFacts:
    """A finished run."""

    folder: Path
    result: dict[str, Any]
    network: NetworkFacts
    events: list[Event]  # of blocks, not of single photons
    setup_ms: list[float]  # of every light path
    sender: list[dict[str, Any]]  # what the sending application said, line by line

    @property
    def service(self) -> str:
        """The service that was used."""
        return str(self.result.get("service", "sdc"))

    @property
    def carries_bytes(self) -> bool:
        """Whether the run was to bring bytes from one host to the other."""
        return carries_bytes(self.result)

    @property
    def has_events(self) -> bool:
        """Whether the run wrote what happened to qubits."""
        return bool(self.result.get("events", True))

    @property
    def has_packets(self) -> bool:
        """Whether the run captured packets."""
        return bool(self.result.get("captures"))

    @property
    def confusion(self) -> NDArray[np.int64] | None:
        """How often each symbol sent (row) was received as which (column), of frames delivered.

        None if the receiver did not come to say it.
        """
        counts = self.result.get("confusion")
        return None if counts is None else np.array(counts, dtype=np.int64)


def read_run(folder: Path) -> RunFacts:
    """Read a run; raise BadRun for a folder without, MalformedPacket for a spoiled capture."""
    result, network = read_result(folder)
    if "delivered" not in result:
        raise BadRun(f"{folder} is of `qmn cli` or a script: only `qmn run` has a report")
    capture = folder / EVENT_CAPTURE
    events = recorded(capture, follow=False) if capture.exists() else iter(())
    return RunFacts(
        folder.resolve(),
        result,
        network,
        [event for event in events if not event.photon],
        [line["setup_ms"] for line in read_record(folder) if line["event"] == "path_ready"],
        _lines(folder / SENDER_LOG),
    )


def read_result(folder: Path) -> tuple[dict[str, Any], NetworkFacts]:
    """Return what a run or a network has left as its result, and the network; raise BadRun."""
    try:
        result = json.loads((folder / RESULT).read_text())
        if "network" not in result and "error" in result:
            raise BadRun(f"the network of {folder} had not started: {result['error']}")
        return result, NetworkFacts.from_dict(result["network"])
    except OSError as error:
        text = "name the folder of a run that has ended, as runs/latest"
        raise BadRun(f"cannot read {error.filename}: {error.strerror}; {text}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise BadRun(
            f"{folder / RESULT} does not say what the network was ({error}): it did not start, or "
            "another version made the run"
        ) from error


def _lines(file: Path) -> list[dict[str, Any]]:
    """Return the lines of JSON that say how far the sender was; none if there is no log."""
    lines = file.read_text(errors="replace").splitlines() if file.exists() else []
    decoded = [fields_of(line) for line in lines]
    return [fields for fields in decoded if "elapsed_s" in fields and "bell_pairs" in fields]
