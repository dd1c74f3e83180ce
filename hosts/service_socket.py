"""A socket for the services other than bytes: teleportation, key distribution and the like.

    with ServiceSocket() as asking:
        for result in asking.request("teleport", ("bob", 9), count=1000):
            print(result)
        print(asking.summary["fidelity"])

The host that is asked listens: listen(9, "teleport"), then accept, then results.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hosts.stack_socket import QuantumSocketError, StackSocket
from wire.socket_calls import Call, decode_fields, encode_fields


class ServiceSocket(StackSocket):
    """One end of a service; both ends are told results while it goes on, and a summary."""

    def __init__(self, stack: Path | str | None = None) -> None:
        super().__init__(stack)
        self.summary: dict[str, Any] = {}

    def request(
        self, service: str, address: tuple[str, int], **options: Any
    ) -> Iterator[dict[str, Any]]:
        """Ask a listening application on a host for a service; yield results until it is over.

        Raise QuantumSocketError with the reason if it cannot be had.
        """
        host, port = address
        words = {"service": service, "host": host, "port": port}
        self._socket.sendall(encode_fields(Call.REQUEST, **words, **options))
        return self.results()

    def results(self) -> Iterator[dict[str, Any]]:
        """Yield what the stack tells of the service until it is over; `summary` is there then."""
        while True:
            call, payload = self._read()
            if call == Call.CLOSE:
                self.summary = decode_fields(payload)
                return
            if call != Call.RESULT:
                raise QuantumSocketError(f"the stack answered {call.name} in a service")
            yield decode_fields(payload)
