"""Options of every run, of what it leaves behind and how fast bits go."""

from dataclasses import dataclass
from pathlib import Path

from topologies.slow_copper import LEAST_MBPS, MOST_MBPS
from wire.parameters.option import option


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What every run can be told beside its network and its job."""

    runs: Path = option(Path("runs"), "what runs leave (runs)", metavar="DIR")
    classical_mbps: float | None = option(
        None,
        "slow classical channel: Mbit/s of quantum metadata that a host can send (no limit)",
        metavar="MBPS",
        range=(LEAST_MBPS, MOST_MBPS),
    )
    qasm: bool = option(False, "write what is done to qubits to quantum.qasm")
    capture: bool = option(True, "do not capture packets")
    events: bool = option(True, "do not write what happens to qubits")
    record: bool = option(True, "do not record what `qmn replay` needs")
    report: bool = option(True, "draw no report; `qmn report` makes it later")
