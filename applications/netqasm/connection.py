"""NetQASM's connection to a processing unit, over the socket of this host's stack."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from netqasm.lang.encoding import RegisterName
from netqasm.lang.operand import Register
from netqasm.sdk.connection import BaseNetQASMConnection
from netqasm.sdk.network import NetworkInfo
from netqasm.sdk.shared_memory import SharedMemory
from numpy.typing import NDArray

from applications.netqasm.placement import Placement
from applications.netqasm.round_end import RoundEnd
from applications.processing_unit.messages import ReturnedArray, ReturnedRegister
from applications.processing_unit.processing_socket import ProcessingSocket
from applications.processing_unit.subroutine import REGISTERS_IN_A_BANK
from hosts.stack_socket import QuantumSocketError


class Connection(BaseNetQASMConnection):
    placement: Placement  # these two are set where the class is installed
    ends: Mapping[str, RoundEnd]  # by role

    def __init__(self, app_name: str, *arguments: Any, **words: Any) -> None:
        """Connect and begin; the words are those of every connection of the SDK."""
        self._unit = ProcessingSocket(self.placement.stacks[self.placement.known(app_name)])
        self._nodes = list(self._unit.begin())
        self._memory, self._failed, self._leaves = SharedMemory(), False, False
        try:
            super().__init__(app_name, *arguments, **words)
        except BaseException:
            self._unit.close()
            raise
        self._log_subroutines_dir = None  # the SDK would pickle what was sent

    @property
    def shared_memory(self) -> SharedMemory:
        return self._memory

    def close(self, *arguments: Any, **words: Any) -> None:
        """Send what is left to send; qubits that are left stay until the end of the round."""
        try:
            super().close(*arguments, **words)
        finally:
            if self._leaves:
                self.ends[self.app_name].keep(self._unit)
            else:
                self._unit.close()

    def block(self) -> None:
        """Return at once: a subroutine is done when it has been sent."""

    def look(self, qubit: int, entangled: bool) -> NDArray[np.complex128]:
        return self._unit.look(qubit, entangled)

    def _commit_serialized_message(
        self, raw_msg: bytes, block: bool = True, callback: Callable[[], Any] | None = None
    ) -> None:
        """Have the unit deal with a message, and remember what it returns."""
        try:
            answers = self._unit.send(raw_msg)
        except QuantumSocketError:
            self._failed = True
            raise
        for answer in answers:
            match answer:
                case ReturnedArray(address, values):
                    self._memory.init_new_array(address, new_array=values)
                case ReturnedRegister(register, value):
                    self._memory.set_register(_register(register), value)
        if callback is not None:
            callback()

    def _signal_stop(self, *arguments: Any, **words: Any) -> None:
        """Tell the unit that this is the end, unless qubits are left or the application failed."""
        self._leaves = bool(self.active_qubits) and not self._failed
        if not self._leaves and not self._failed:
            super()._signal_stop(*arguments, **words)

    def _get_network_info(self) -> type[NetworkInfo]:
        placement, nodes = self.placement, self._nodes

        class Info(NetworkInfo):
            """Numbers of nodes and places of roles."""

            @classmethod
            def _get_node_id(cls, node_name: str) -> int:
                return nodes.index(node_name)

            @classmethod
            def _get_node_name(cls, node_id: int) -> str:
                return nodes[node_id]

            @classmethod
            def get_node_id_for_app(cls, app_name: str) -> int:
                return nodes.index(placement.host(app_name))

            @classmethod
            def get_node_name_for_app(cls, app_name: str) -> str:
                return placement.host(app_name)

        return Info


def _register(number: int) -> Register:
    bank, index = divmod(number, REGISTERS_IN_A_BANK)
    return Register(RegisterName(bank), index)


def get_qubit_state(qubit: Any, reduced_dm: bool = True) -> NDArray[np.complex128]:
    """Return the density matrix of a qubit; not reduced: of all that it is entangled with, too.

    The qubit is the first of these. Gates that the program has asked for are done first: anonymous
    transmission does not flush its corrections. Raise QuantumSocketError where nobody may look.
    """
    qubit.connection.flush()
    matrix: NDArray[np.complex128] = qubit.connection.look(qubit.qubit_id, not reduced_dm)
    return matrix
