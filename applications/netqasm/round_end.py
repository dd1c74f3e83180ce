"""The end of a round: qubits that a program leaves stay until the programs of all roles have ended.

Each program sends an empty text to each other one, by a socket of their own.
"""

from collections.abc import Callable, Collection
from contextlib import suppress

from applications.netqasm.texts import Socket
from applications.processing_unit.processing_socket import ProcessingSocket
from applications.timeouts import ROUND_TIMEOUT_S

SOCKET = -1  # programs number theirs from 0


class RoundEnd:
    def __init__(self, others: Collection[str], join: Callable[[str], Socket]) -> None:
        self._others, self._join = others, join
        self._sockets: list[Socket] = []
        self._left: list[ProcessingSocket] = []

    def keep(self, unit: ProcessingSocket) -> None:
        self._left.append(unit)

    def wait(self) -> None:
        """Wait until the other programs have ended the round; discard all qubits that are left.

        A program that is gone has ended. Raise TimeoutError if one goes on for too long.
        """
        try:
            self._sockets = self._sockets or [self._join(other) for other in self._others]
            for each in self._sockets:
                with suppress(ConnectionError):
                    each.send("")
            for each in self._sockets:
                with suppress(ConnectionError):
                    each.recv(timeout=ROUND_TIMEOUT_S)
        except TimeoutError as error:
            raise TimeoutError(
                f"the round does not end in {ROUND_TIMEOUT_S:g} s: {error}"
            ) from error
        finally:
            for unit in self._left:
                unit.close()
            self._left.clear()
