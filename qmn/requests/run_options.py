"""Options of every run, of what it leaves behind and how fast bits go."""

from argparse import ArgumentTypeError
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from qmn.machines.options import MachineOptions
from topologies.networks.captures import HEADERS_BYTES, MAX_PACKET_BYTES
from wire.parameters.checks import check_choice
from wire.parameters.network import LEAST_MBPS, MOST_MBPS
from wire.parameters.option import CONTROL, option

EVENTS, RECORD, REPORT = "events", "record", "report"  # files of a run that it can do without
# Bytes of each packet at most.
CAPTURES = {"full": MAX_PACKET_BYTES, "headers": HEADERS_BYTES, "none": 0}


def omitted(text: str) -> str:
    for word in text.split(","):
        check_choice("file", word, (EVENTS, RECORD, REPORT), ArgumentTypeError)
    return text


@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """Options of the live page, of every verb that starts networks."""

    live: bool = option(
        False,
        "show each network in the browser as it runs, and print the address (`qmn live`)",
        recorded=False,
    )
    live_for_all: bool = option(
        False,
        "--live, and a read-only address of it for all in this machine's network, by TLS",
        recorded=False,
    )

    @property
    def shown(self) -> bool:
        return self.live or self.live_for_all


@dataclass(frozen=True, kw_only=True)
class RunOptions(LiveOptions, MachineOptions):
    """Options of every run beside its network and its job."""

    runs: Path = option(
        Path("runs"), "folder for what runs leave (runs)", metavar="DIR", recorded=False
    )
    classical_mbps: float | None = option(
        None,
        "slow classical channel: Mbit/s of quantum metadata that a host can send (no limit)",
        metavar="MBPS",
        range=(LEAST_MBPS, MOST_MBPS),
        group=CONTROL,
    )
    qasm: bool = option(False, "write what is done to qubits to quantum.qasm", recorded=False)
    captures: str = option(
        "full",
        "capture packets in full, their headers (first 640 bytes), or none (full)",
        choices=CAPTURES,
        recorded=False,
    )
    without: tuple[str, ...] = option(
        (),
        f"leave out {EVENTS} of qubits, the {RECORD} for `qmn replay`, or the {REPORT}, which "
        f"`qmn report` makes later, as {EVENTS},{REPORT}",
        metavar="FILES",
        parse=omitted,
        recorded=False,
    )

    @property
    def against_steps(self) -> Iterator[str]:
        """Yield the reasons of this run why its time is paced."""
        yield from super().against_steps
        if self.classical_mbps is not None:
            yield "the kernel counts --classical-mbps by the wall"

    @property
    def packet_bytes(self) -> int:
        """Return how many bytes of each packet are captured at most; 0: there are no captures."""
        return CAPTURES[self.captures]

    @property
    def events(self) -> bool:
        """Return whether what happens to qubits is written."""
        return self._has(EVENTS)

    @property
    def record(self) -> bool:
        """Return whether what `qmn replay` needs is written."""
        return self._has(RECORD)

    @property
    def report(self) -> bool:
        return self._has(REPORT)

    def _has(self, file: str) -> bool:
        return file not in ",".join(self.without).split(",")
