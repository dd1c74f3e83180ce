"""The figures of entanglement swapping: pairs/s by length of the chain, over a real network."""

import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from hosts.service_socket import ServiceSocket
from topologies.network import Network, Signals
from topologies.repeaters import RepeatersTopo
from topologies.runtime import Runtime

LENGTHS = (1, 2, 4, 8)  # repeaters
PAIRS = 100_000
PORT = 9
TIMEOUT_S = 60.0


def swap_figures(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each figure."""
    for repeaters in LENGTHS:
        topology = partial(RepeatersTopo, repeaters=repeaters)
        runtime = Runtime(log_folder=folder / f"repeaters-{repeaters}")
        with Network(topology, runtime, signals) as network:
            told = one_session(network, PAIRS)
        plural = "s" if repeaters > 1 else ""
        yield (
            f"swapped by {repeaters} repeater{plural}",
            f"{told['pairs_per_s']:,.0f} pairs/s: {told['pairs']:,} in {told['elapsed_s']:.2f} s",
        )


def one_session(network: Network, count: int) -> dict[str, Any]:
    """Have alice share pairs with bob; return what she is told when they are delivered."""
    with (
        ServiceSocket(network.runtime.socket("bob")) as listener,
        ServiceSocket(network.runtime.socket("alice")) as asking,
    ):
        for end in (listener, asking):
            end.settimeout(TIMEOUT_S)
        listener.listen(PORT, "swap")
        accepting = threading.Thread(target=_take_part, args=(listener,))
        accepting.start()
        for _result in asking.request("swap", ("bob", PORT), count=count, sample=0):
            continue
        asking.shutdown()
        accepting.join(TIMEOUT_S)
        return asking.summary


def _take_part(listener: ServiceSocket) -> None:
    connection, _peer = listener.accept()
    with connection:
        while not connection.over:
            for _result in connection.results():
                continue
