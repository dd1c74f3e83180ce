"""The Bell analysers of a switch to its controllers: counts, and a frame for each outcome."""

from collections.abc import Callable

from qswitch_agent.openflow.ports import Port
from wire.analyser_frames import BROADCAST, AnalyserCounts, AnalyserFrame, frames_of
from wire.parameters.switch import inner_ports

NO_ADDRESS = bytes(6)


class Analysers:
    """All of one switch."""

    def __init__(self, count: int, send: Callable[[int, bytes], None]) -> None:
        """`send` lets flow entries decide on a frame that comes from a port."""
        self.ports = inner_ports(count)
        self._send = send
        self._addresses: dict[int, bytes] = {}  # of the inner ports
        first = [port for port, (_analyser, which) in self.ports.items() if which == 1]
        self._counts = {port: AnalyserCounts(port) for port in first}

    def update(self, ports: list[Port]) -> None:
        self._addresses |= {port.number: port.address for port in ports}

    def report(self, report: AnalyserFrame) -> None:
        """Count outcomes, and send them by the flow entries of the analyser's port."""
        self._counts[report.port].add(report)
        sender = self._addresses.get(report.port, NO_ADDRESS)
        for frame in frames_of(report):
            self._send(report.port, frame.encode(BROADCAST, sender))

    def encode_counts(self) -> bytes:
        return b"".join(counts.encode() for counts in self._counts.values())
