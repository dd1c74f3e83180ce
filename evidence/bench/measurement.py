"""Programs that print measurements, and statistics of many times."""

import statistics
import time
from dataclasses import dataclass, field

from qmn.results.result import percentiles
from qmn.timeouts import MEASURE_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError, Program
from topologies.timeouts import POLL_S


@dataclass
class Times:
    """Times of equal events in ms, and the seconds that all took, with what lay between."""

    each_ms: list[float] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def p50_ms(self) -> float:
        return statistics.median(self.each_ms)

    @property
    def per_s(self) -> float:
        return len(self.each_ms) / self.seconds

    def __str__(self) -> str:
        return str(percentiles(self.each_ms))

    def __add__(self, more: "Times") -> "Times":
        return Times(self.each_ms + more.each_ms, self.seconds + more.seconds)


def finish(network: Network, program: Program) -> str:
    """Wait for the end of a program and return the last line that it printed."""
    deadline = time.monotonic() + MEASURE_TIMEOUT_S
    while program.running:
        network.check()
        if time.monotonic() > deadline:
            raise NetworkError(f"{program.name} did not end in {MEASURE_TIMEOUT_S:g} s")
        time.sleep(POLL_S)
    if program.status:
        raise NetworkError(f"{program.name} failed: {program.end()}")
    return program.last_words()


def seconds_of(network: Network, program: Program) -> float:
    """Wait for the end of a program and return the number that it printed."""
    name, _space, number = finish(network, program).partition(" ")
    if name != "seconds":
        raise NetworkError(f"{program.name} failed: {program.end()}")
    return float(number)
