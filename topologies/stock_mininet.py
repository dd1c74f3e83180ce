"""Mininet as its own program `mn` is to have it: for topologies of ours, and no longer than it may.

What topologies.network.Network does for `qmn` around a network, this does here.
"""

from topologies import runtime
from topologies.iperf import IperfMininet


class StockMininet(IperfMininet):
    """Mininet whose `iperf` ends, and whose nodes' commands have deadlines.

    People's own commands, between its start and its end, may take as long as they like.
    """

    def build(self) -> None:
        """Make all nodes and links."""
        with runtime.current().in_a_hurry():
            super().build()

    def start(self) -> None:
        """Start controllers and switches."""
        with runtime.current().in_a_hurry():
            super().start()

    def stop(self) -> None:
        """Stop everything; a shell that does not answer is killed, and the rest goes on."""
        runtime.current().ending = True
        super().stop()
