"""How errors grew during a run: by the receiver's reports, or else by what the sender said."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qmn.network_facts import NetworkFacts
from qmn.reports.packets import messages
from wire.metadata import Report

MAX_CAPTURE_BYTES = 50_000_000  # 0.4 s to read
NAMES = {
    "symbol errors": "symbol_errors",
    "lost pairs": "lost_pairs",
    "repeated frames": "repeated_frames",
}


@dataclass(frozen=True)
class ErrorCounts:
    """Counts at times since the session began; the first are 0, as a session has no error then."""

    seconds: list[float]
    counts: dict[str, list[int]]
    whence: str

    @property
    def last(self) -> str:
        """The counts of the end, in words."""
        return ", ".join(f"{values[-1]:,} {label}" for label, values in self.counts.items())


def reported(folder: Path, network: NetworkFacts, sender: str) -> ErrorCounts | None:
    """Return what the receiver's reports said as they came to a host; None if none is captured."""
    captures = [file for file in folder.glob("*.pcap") if network.host_at(file.stem) == sender]
    if not captures or captures[0].stat().st_size > MAX_CAPTURE_BYTES:
        return None
    rows: list[tuple[int, int, int, int]] = []
    wrong: dict[int, int] = defaultdict(int)  # by session
    lost = repeated = 0
    for time_ns, flow, _place, message in messages(captures[0]):
        if not rows:
            rows.append((time_ns, 0, 0, 0))
        if isinstance(message, Report) and flow.target == network.addresses.get(sender):
            wrong[message.session] = message.errors
            lost += message.lost
            repeated += len(message.failed)
            rows.append((time_ns, sum(wrong.values()), lost, repeated))
    if len(rows) < 2:
        return None
    times, *columns = map(list, zip(*rows, strict=True))
    seconds = [(time_ns - times[0]) / 1e9 for time_ns in times]
    text = "From the receiver's reports as they came, after every block"
    return ErrorCounts(seconds, dict(zip(NAMES, columns, strict=True)), text)


def said(lines: Sequence[Mapping[str, Any]]) -> ErrorCounts | None:
    """Return what the sending application said; None if it said nothing."""
    if not lines:
        return None
    counts = {label: [0, *(line[name] for line in lines)] for label, name in NAMES.items()}
    text = "As the sender heard of them, chunk by chunk"
    return ErrorCounts([0.0, *(line["elapsed_s"] for line in lines)], counts, text)
