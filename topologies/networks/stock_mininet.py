"""Mininet as its own program `mn` is to have it: for topologies of ours, and no longer than it may.

It does here what topologies.networks.network.Network does for `qmn` around a network.
"""

from mininet.log import error

from topologies.networks.disk import DiskKeeper
from topologies.networks.heard_orders import HeardOrders
from topologies.networks.iperf import IperfMininet
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime


class StockMininet(HeardOrders, IperfMininet):
    """Mininet whose `iperf` ends, whose nodes' commands have deadlines, and whose logs are bounded.

    People's own commands, between its start and its end, may take as long as they like.
    """

    _keeper: DiskKeeper | None = None

    def build(self) -> None:
        """Make all nodes and links; from now on their programs' logs are looked after."""
        network = runtime.current()
        self._keeper = DiskKeeper([network.logs], lambda: network.programs)
        self._keeper.__enter__()
        with network.time_limit():
            super().build()

    def start(self) -> None:
        with runtime.current().time_limit():
            super().start()
        self.hears = True

    def configLinkStatus(self, src: str, dst: str, status: str) -> None:  # noqa: N802 (Mininet's)
        """Cut or mend the links between two nodes; report errors as `mn` does."""
        try:
            super().configLinkStatus(src, dst, status)
        except NetworkError as fault:
            error(f"{fault}\n")

    def stop(self) -> None:
        """Stop everything; a shell that does not answer is killed, and the rest goes on."""
        runtime.current().ending = True
        super().stop()
        if self._keeper is not None:
            self._keeper.__exit__()
