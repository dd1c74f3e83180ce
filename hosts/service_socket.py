"""A socket for any service: teleportation, key distribution and the like; for bytes, its subclass.

    with ServiceSocket() as asking:
        for result in asking.request("teleport", ("bob", 9), count=1000):
            print(result)
        print(asking.summary["fidelity"])

Results of a service at a host can be used until the one that asked for it ends the session:

        for result in asking.request("distribute", ("bob", 9), count=1000):
            print(result)
        print(asking.ask(measure=[0, 1, 2], basis="Z")["outcomes"])
        asking.shutdown()

The host that is asked listens: listen(9, "teleport"), then accept, then results.
"""

import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from hosts.stack_socket import QuantumSocketError, StackSocket, not_refused
from hosts.timeouts import CLOSING_TIMEOUT_S
from wire.socket_calls import Call, decode_fields, encode, encode_fields


class ServiceSocket(StackSocket):
    """One end of a service; both ends get results while it goes on, and a summary."""

    def __init__(self, stack: Path | str | None = None) -> None:
        super().__init__(stack)
        self.over = False
        self._asked = False

    def request(
        self, service: str, address: tuple[str, int], **options: Any
    ) -> Iterator[dict[str, Any]]:
        """Ask a listening application on a host for a service; yield results until it is over.

        Raise QuantumSocketError with the reason if it cannot be had.
        """
        host, port = address
        self._send(encode_fields(Call.REQUEST, service=service, host=host, port=port, **options))
        self._asked = True
        return self.results()

    def results(self) -> Iterator[dict[str, Any]]:
        """Yield what the stack tells of the service until it is over or may be asked.

        `summary` is complete then; `over` says whether it is over. Called again: wait until it is.
        """
        while not self.over:
            call, payload = self._read()
            if call in (Call.CLOSE, Call.DONE):
                self.summary, self.over = decode_fields(payload), call == Call.CLOSE
                return
            if call != Call.RESULT:
                raise QuantumSocketError(f"the stack answered {call.name} in a service")
            yield decode_fields(payload)

    def intercept(self, fraction: float = 1.0, **options: Any) -> Iterator[dict[str, Any]]:
        """Attack a fraction of the light that goes by way of this host, and send it on.

        Options: attack="resend" measures photons, "split" takes some of pulses that have several;
        then expected_db and onward_db are what light loses from here to a click.

        It has begun when this returns. Yield what was seen of each block, until `shutdown`;
        `summary` is complete then. Raise QuantumSocketError with the reason if it cannot be.
        """
        self._send(encode_fields(Call.INTERCEPT, fraction=fraction, **options))
        self._done()
        return self.results()

    def stop(self) -> None:
        """Let an interception end, from any thread or signal handler; its results then end, too."""
        self._send(encode(Call.CLOSE))

    def ask(self, **question: Any) -> dict[str, Any]:
        """Ask about what the service has left here; return the answer.

        Raise QuantumSocketError with the reason if it is refused; then one may go on asking.
        """
        if not self.over:
            self._send(encode_fields(Call.ASK, **question))
            call, payload = self._read()
            if call == Call.DONE:
                return not_refused(decode_fields(payload))
            if call != Call.CLOSE:
                raise QuantumSocketError(f"the stack answered {call.name} to a question")
            self.summary, self.over = decode_fields(payload), True
        raise QuantumSocketError("the session is over, and nothing is left of it")

    def shutdown(self) -> None:
        """End the session that this end has asked for; return when it is over at both ends."""
        if not self.over:
            self._send(encode(Call.CLOSE))
            list(self.results())

    def close(self) -> None:
        """Close; a session that this end has asked for and not ended is broken off.

        The stack has done so when this returns, unless that takes too long: a next request for the
        same light is not refused for the sake of this session.
        """
        if self._asked and not self.over:
            self._wait_until_broken_off()
        super().close()

    def _wait_until_broken_off(self) -> None:
        self._closed, deadline = True, time.monotonic() + CLOSING_TIMEOUT_S
        with suppress(OSError):  # TimeoutError is one
            self._socket.shutdown(socket.SHUT_WR)
            while (left_s := deadline - time.monotonic()) > 0:
                self._socket.settimeout(left_s)
                if not self._socket.recv(1 << 16):
                    return
