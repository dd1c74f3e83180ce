"""A socket to the processing unit of a host: NetQASM's messages there, its answers back."""

import numpy as np
from numpy.typing import NDArray

from applications.processing_unit.messages import Finished, UnitMessage, decode_unit_message
from hosts.stack_socket import QuantumSocketError, StackSocket, not_refused
from wire.socket_calls import Call, decode_fields, encode, encode_fields


class ProcessingSocket(StackSocket):
    """One application's connection to the unit; what it leaves there is gone when it closes."""

    def begin(self) -> dict[str, str]:
        """Begin an application; return the addresses of all nodes by name, in NetQASM's order."""
        self._send(encode_fields(Call.PROCESS))
        call, payload = self._read()
        if call != Call.DONE:
            raise QuantumSocketError(f"the stack answered {call.name} to PROCESS")
        self.summary = decode_fields(payload)
        nodes: dict[str, str] = self.summary["nodes"]
        return nodes

    def send(self, message: bytes) -> list[UnitMessage]:
        """Have the unit deal with a message; return what it answers, without the end of it.

        Raise QuantumSocketError with the reason if it cannot be done.
        """
        self._send(encode(Call.DATA, message))
        answers: list[UnitMessage] = []
        while True:
            call, payload = self._read()
            if call != Call.DATA:
                raise QuantumSocketError(f"the stack answered {call.name} to NetQASM")
            answer = decode_unit_message(payload)
            if isinstance(answer, Finished):
                return answers
            answers.append(answer)

    def look(self, qubit: int, entangled: bool) -> NDArray[np.complex128]:
        """Return the density matrix of a qubit, perhaps with all that it is entangled with.

        Raise QuantumSocketError where states may not be looked at, as in none of hardware.
        """
        self._send(encode_fields(Call.ASK, look=qubit, entangled=entangled))
        fields = not_refused(self._done())
        return np.array(fields["real"]) + 1j * np.array(fields["imaginary"])
