"""The registers of one client of the Sabot server."""

from itertools import count

from dispatcher.refusal import exhausted, not_found
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import Register

MAX_REGISTERS = 200_000
MAX_WORKSPACES = 16


class Workspace:
    """Quantum states on one backend, and the numbers of their registers."""

    def __init__(self, sabot: Sabot) -> None:
        self.sabot = sabot
        self._registers: dict[int, Register] = {}
        self._numbers: dict[Register, int] = {}
        self._next = count(1)

    def require(self, number: int) -> Register:
        """Return the register of this number, or refuse."""
        register = self._registers.get(number)
        if register is None:
            raise not_found(f"no register {number} in this workspace; create it first")
        return register

    def require_place(self, more: int) -> None:
        """Refuse more registers than there may be."""
        if len(self._registers) + more > MAX_REGISTERS:
            raise exhausted(f"{MAX_REGISTERS} registers are live; measure or drop some first")

    def add(self, register: Register) -> int:
        number = next(self._next)
        self._registers[number] = register
        self._numbers[register] = number
        return number

    def remove(self, number: int) -> None:
        del self._numbers[self._registers.pop(number)]

    def number(self, register: Register) -> int:
        return self._numbers[register]


class Workspaces:
    """All clients' registers."""

    def __init__(self, max_live_qubits: int) -> None:
        """Hold at most so many qubits."""
        self._max_live_qubits = max_live_qubits
        self._all: dict[int, Workspace] = {}
        self._next = count(1)

    def begin(self, sabot: Sabot) -> int:
        if len(self._all) >= MAX_WORKSPACES:
            raise exhausted(f"{MAX_WORKSPACES} workspaces are in use; end one, or this server")
        number = next(self._next)
        self._all[number] = Workspace(sabot)
        return number

    def end(self, number: int) -> None:
        self.require(number)
        del self._all[number]

    def require(self, number: int) -> Workspace:
        """Return the workspace of this number, or refuse."""
        workspace = self._all.get(number)
        if workspace is None:
            raise not_found(f"no workspace {number}; begin one first")
        return workspace

    def require_capacity(self, more: int) -> None:
        """Refuse more qubits than there may be."""
        live = sum(workspace.sabot.live_qubits for workspace in self._all.values())
        if live + more > self._max_live_qubits:
            raise exhausted(
                f"{more} more qubits with {live} live exceed the limit of "
                f"{self._max_live_qubits}; measure or drop some first"
            )
