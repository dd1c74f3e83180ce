"""The classical memory of one application: registers and arrays of 32-bit integers.

An outcome can be moved before it is known: then it is an Outcome.
"""

from collections.abc import Sequence

from applications.processing_unit.messages import MAX_ENTRIES
from applications.processing_unit.qubits import Outcome
from applications.processing_unit.subroutine import register_name
from hosts.middleware.session.errors import unsupported

LEAST, MOST = -(1 << 31), (1 << 31) - 1
MAX_ARRAYS = 4096
MAX_TOTAL = 1 << 20  # entries of all arrays

Value = int | Outcome | None  # None: not defined


class ClassicalMemory:
    def __init__(self) -> None:
        self._registers: dict[int, Value] = {}
        self._arrays: dict[int, list[Value]] = {}

    def set(self, register: int, value: Value) -> None:
        if isinstance(value, int) and not LEAST <= value <= MOST:
            raise unsupported(f"{value} in register {register_name(register)}: it has 32 bits")
        self._registers[register] = value

    def raw(self, register: int) -> Value:
        """Return what a register holds, which may not be known yet."""
        return self._registers.get(register)

    def defined(self, register: int) -> int | Outcome:
        """Return what a register holds; raise SessionError if that is nothing."""
        value = self._registers.get(register)
        if value is None:
            raise unsupported(f"register {register_name(register)} is not defined")
        return value

    def new_array(self, address: int, length: int) -> None:
        total = sum(map(len, self._arrays.values()))
        if not 0 <= length <= MAX_ENTRIES or total + length > MAX_TOTAL:
            raise unsupported(
                f"an array of {length} entries: at most {MAX_ENTRIES}, and {MAX_TOTAL}"
            )
        if len(self._arrays) >= MAX_ARRAYS:
            raise unsupported(f"{MAX_ARRAYS} arrays are the most")
        self._arrays[address] = [None] * length

    def array(self, address: int) -> list[Value]:
        """Return an array, to be read or changed; raise SessionError if there is none."""
        if address not in self._arrays:
            raise unsupported(f"there is no array at address {address}")
        return self._arrays[address]

    def entries(self, address: int | None) -> Sequence[Value]:
        """Return the entries of an array; none if there is no such array."""
        return () if address is None else self._arrays.get(address, ())

    def part(self, address: int, start: int, stop: int) -> list[Value]:
        """Return a slice of an array; raise SessionError if it is not inside."""
        array = self.array(address)
        if not 0 <= start <= stop <= len(array):
            raise unsupported(f"entries {start} to {stop} of an array of {len(array)}")
        return array[start:stop]

    def entry(self, address: int, index: int) -> Value:
        """Return an entry of an array; raise SessionError if it is not defined."""
        (value,) = self.part(address, index, index + 1)
        if value is None:
            raise unsupported(f"entry {index} of the array at address {address} is not defined")
        return value

    def put(self, address: int, index: int, value: Value) -> None:
        self.part(address, index, index + 1)
        self._arrays[address][index] = value
