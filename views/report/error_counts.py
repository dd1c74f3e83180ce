"""The growth of errors during a run: by the receiver's reports, or else by the sender."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from views.report.packets import messages
from wire.metadata.blocks import Block, Emit, Report
from wire.results.figures import SentFigures
from wire.results.run_result import NetworkFacts

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
        return ", ".join(f"{label} {values[-1]:,}" for label, values in self.counts.items())


def reported(folder: Path, network: NetworkFacts, sender: str) -> ErrorCounts | None:
    """Return the counts of reports that reached a sending host; None if none is captured.

    Pairs of which no light came to the sender itself are in no report: they are those that the
    sender ordered, less those that it announced.
    """
    captures = [file for file in folder.glob("*.pcap") if network.host_at(file.stem) == sender]
    if not captures or captures[0].stat().st_size > MAX_CAPTURE_BYTES:
        return None
    rows: list[tuple[int, int, int, int]] = []
    wrong: dict[int, int] = {}  # by session
    ordered = lost = repeated = 0  # pairs ordered of the source since the last block
    for time_ns, flow, _place, message in messages(captures[0]):
        if not rows:
            rows.append((time_ns, 0, 0, 0))
        if flow.source == network.addresses[sender]:
            if isinstance(message, Emit):
                ordered += message.pairs
            elif isinstance(message, Block):
                lost += ordered - message.pairs  # no light of them came to the sender
                ordered = 0
        elif isinstance(message, Report):
            wrong[message.session] = message.errors
            lost += message.lost
            repeated += len(message.failed)
            rows.append((time_ns, sum(wrong.values()), lost, repeated))
    if len(rows) < 2:
        return None
    times, *columns = map(list, zip(*rows, strict=True))
    seconds = [(time_ns - times[0]) / 1e9 for time_ns in times]
    text = "After every block, when the receiver's report of it came"
    return ErrorCounts(seconds, dict(zip(NAMES, columns, strict=True)), text)


def printed(lines: Sequence[SentFigures], scale: float) -> ErrorCounts | None:
    """Return the counts that the sending application printed; None if it printed none.

    Of its time, that of the network, a second took `scale` seconds here.
    """
    if not lines:
        return None
    counts = {label: [0, *(getattr(line, name) for line in lines)] for label, name in NAMES.items()}
    text = "As reported to the sender, chunk by chunk"
    return ErrorCounts([0.0, *(line.elapsed_s * scale for line in lines)], counts, text)
