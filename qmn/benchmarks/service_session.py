"""One session of a service between alice and bob, asked for by this process."""

import threading
from typing import Any

from hosts.service_socket import ServiceSocket
from qmn.timeouts import MEASURE_TIMEOUT_S
from topologies.network import Network

PORT = 9


def one_session(network: Network, service: str, **options: Any) -> dict[str, Any]:
    """Have alice ask bob for a service; return what she is told at the end."""
    with (
        ServiceSocket(network.runtime.socket("bob")) as listener,
        ServiceSocket(network.runtime.socket("alice")) as asking,
    ):
        for end in (listener, asking):
            end.settimeout(MEASURE_TIMEOUT_S)
        listener.listen(PORT, service)
        accepting = threading.Thread(target=_take_part, args=(listener,))
        accepting.start()
        for _result in asking.request(service, ("bob", PORT), **options):
            continue
        asking.shutdown()  # of what it leaves, if it leaves anything
        accepting.join(MEASURE_TIMEOUT_S)
        return asking.summary


def _take_part(listener: ServiceSocket) -> None:
    connection, _peer = listener.accept()
    with connection:
        while not connection.over:
            for _result in connection.results():
                continue
