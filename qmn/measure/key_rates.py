"""The figures of key distribution: raw, sifted and final bits/s over a real network."""

import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from hosts.service_socket import ServiceSocket
from topologies.network import Network, Signals
from topologies.runtime import Runtime
from topologies.sdc import SdcTopo

PROTOCOLS = ("bb84", "bbm92")
DEPOLARIZING = 0.01  # of each fibre
SIFTED_BITS = 1_000_000
PORT = 9
TIMEOUT_S = 60.0


def key_figures(folder: Path, signals: Signals) -> Iterator[tuple[str, str]]:
    """Yield name and text of each figure."""
    runtime = Runtime(log_folder=folder / "keys")
    with Network(partial(SdcTopo, depolarizing=DEPOLARIZING), runtime, signals) as network:
        for protocol in PROTOCOLS:
            told = one_session(network, protocol)
            yield (
                f"{protocol}, QBER {told['qber']:.4f}",
                f"raw {told['raw_bits_per_s'] / 1e6:.2f} Mbit/s, "
                f"sifted {told['sifted_bits_per_s'] / 1e6:.2f} Mbit/s, while light is sent",
            )
            yield (
                "  with error correction and all",
                f"final key {told['key_bits_per_s'] / 1e3:.0f} kbit/s: {told['key_bits']:,} bits "
                f"in {told['elapsed_s']:.1f} s",
            )


def one_session(network: Network, protocol: str) -> dict[str, Any]:
    """Have alice make a key with bob; return what she is told at the end."""
    with (
        ServiceSocket(network.runtime.socket("bob")) as listener,
        ServiceSocket(network.runtime.socket("alice")) as asking,
    ):
        for end in (listener, asking):
            end.settimeout(TIMEOUT_S)
        listener.listen(PORT, protocol)
        accepting = threading.Thread(target=_take_part, args=(listener,))
        accepting.start()
        for _result in asking.request(protocol, ("bob", PORT), count=SIFTED_BITS):
            continue
        accepting.join(TIMEOUT_S)
        return asking.summary


def _take_part(listener: ServiceSocket) -> None:
    connection, _peer = listener.accept()
    with connection:
        for _result in connection.results():
            continue
