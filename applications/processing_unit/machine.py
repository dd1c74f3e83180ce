"""The machine that executes the subroutines of one application.

It reads classical instructions itself, gathers what is to be done to qubits, and leaves pairs to
others. Outcomes are only waited for where a branch or a sum depends on them.
"""

import asyncio
from collections.abc import Awaitable, Callable
from inspect import isawaitable

from applications.processing_unit.memory import ClassicalMemory, Value
from applications.processing_unit.messages import ReturnedArray, ReturnedRegister
from applications.processing_unit.qubits import GATES, PAIR_GATES, ROTATIONS, Outcome, Qubits
from applications.processing_unit.subroutine import Instruction, Subroutine
from hosts.middleware.session.errors import unsupported

MOST_EXECUTED = 1_000_000  # instructions of a subroutine
BREATH = 1000  # instructions after which others on this host have their turn

Jump = int | None
Handler = Callable[..., Awaitable[Jump] | Jump]
Ask = Callable[[int, int, int | None, list[Value] | None, int], None]
BRANCHES: dict[str, Callable[[int, int], bool]] = {
    "bez": lambda a, _b: a == 0,
    "bnz": lambda a, _b: a != 0,
    "beq": lambda a, b: a == b,
    "bne": lambda a, b: a != b,
    "blt": lambda a, b: a < b,
    "bge": lambda a, b: a >= b,
}
SUMS: dict[str, Callable[[int, int], int]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "addm": lambda a, b: a + b,
    "subm": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a // b,
    "rem": lambda a, b: a % b,
}
UNITARY = {*GATES, *ROTATIONS, *PAIR_GATES}


class Machine:
    """Registers, arrays and qubits of one application, and what its instructions do to them."""

    def __init__(
        self,
        qubits: Qubits,
        ask: Ask,
        settled: Callable[[Callable[[], bool]], Awaitable[None]],
        arrived: Callable[[int], Awaitable[None]],
    ) -> None:
        """Ask for pairs by `ask`; wait by `settled` for what they bring, by `arrived` for one."""
        self.memory, self.qubits = ClassicalMemory(), qubits
        self._ask, self._settled, self._arrived = ask, settled, arrived
        self._returned: list[tuple[int, Value | list[Value]]] = []

    async def run(self, subroutine: Subroutine) -> list[ReturnedArray | ReturnedRegister]:
        """Execute a subroutine; return what it returns, in order. Raise SessionError if it fails.

        Photons of this host are used up to where it has failed.
        """
        self._returned = []
        place = executed = 0
        instructions = subroutine.instructions
        while place < len(instructions):
            executed += 1
            if executed > MOST_EXECUTED:
                raise unsupported(f"more than {MOST_EXECUTED} instructions: does a loop never end?")
            if executed % BREATH == 0:
                await asyncio.sleep(0)
            jump = await self._execute(instructions[place])
            place = place + 1 if jump is None else jump
            if place < 0:
                raise unsupported(f"a jump to instruction {place}")
        await self.qubits.flush()
        return [_told(*each) for each in self._returned]

    async def _execute(self, instruction: Instruction) -> Jump:
        name, operands = instruction
        if self.qubits.full:
            await self.qubits.flush()
        if name in BRANCHES:
            return await self._branch(name, operands)
        if name in SUMS:
            return await self._sum(name, operands)
        if name in UNITARY:
            await self._act(name, operands)
            return None
        handler: Handler = getattr(self, f"_{name}")
        done = handler(*operands)
        return await done if isawaitable(done) else done

    async def _act(self, name: str, operands: tuple[int, ...]) -> None:
        if name in ROTATIONS:
            register, numerator, denominator = operands
            self.qubits.rotate(name, await self._qubit(register), numerator, denominator)
            return
        numbers = [await self._qubit(register) for register in operands]
        if name in GATES:
            self.qubits.gate(name, *numbers)
        else:
            self.qubits.pair_gate(name, *numbers)

    async def _known(self, register: int) -> int:
        """Return the number in a register, which may take a measurement."""
        value = self.memory.defined(register)
        if isinstance(value, Outcome):
            if value.value is None:
                await self.qubits.flush()
            assert value.value is not None
            return value.value
        return value

    async def _qubit(self, register: int) -> int:
        """Return the number in a register, once a qubit with that number exists."""
        number = await self._known(register)
        if number not in self.qubits:
            await self._arrived(number)
        return number

    async def _branch(self, name: str, operands: tuple[int, ...]) -> Jump:
        *registers, line = operands
        values = [await self._known(register) for register in registers]
        return line if BRANCHES[name](values[0], values[-1]) else None

    async def _sum(self, name: str, operands: tuple[int, ...]) -> Jump:
        into, *registers = operands
        a, b, *modulus = [await self._known(register) for register in registers]
        if (name in ("div", "rem") and b == 0) or (modulus and modulus[0] < 1):
            raise unsupported(f"{name} of {a}, {b} by {modulus[0] if modulus else b}")
        value = SUMS[name](a, b)
        self.memory.set(into, value % modulus[0] if modulus else value)
        return None

    def _jmp(self, line: int) -> Jump:
        return line

    def _set(self, register: int, value: int) -> None:
        self.memory.set(register, value)

    _lea = _set

    async def _array(self, length: int, address: int) -> None:
        self.memory.new_array(address, await self._known(length))

    async def _store(self, register: int, address: int, index: int) -> None:
        value = self.memory.defined(register)
        self.memory.put(address, await self._known(index), value)

    async def _load(self, register: int, address: int, index: int) -> None:
        self.memory.set(register, self.memory.entry(address, await self._known(index)))

    async def _undef(self, address: int, index: int) -> None:
        self.memory.put(address, await self._known(index), None)

    def _ret_reg(self, register: int) -> None:
        self._returned.append((register, self.memory.defined(register)))

    def _ret_arr(self, address: int) -> None:
        self._returned.append((address, list(self.memory.array(address))))

    def _breakpoint(self, _action: int, _role: int) -> None:
        """Do nothing: nobody looks."""

    async def _qalloc(self, register: int) -> None:
        self.qubits.allocate(await self._known(register))

    async def _init(self, register: int) -> None:
        self.qubits.initialize(await self._qubit(register))

    async def _qfree(self, register: int) -> None:
        self.qubits.free(await self._qubit(register))

    async def _mov(self, source: int, target: int) -> None:
        self.qubits.move(await self._qubit(source), await self._known(target))

    async def _swp(self, first: int, second: int) -> None:
        self.qubits.swap(await self._qubit(first), await self._qubit(second))

    async def _meas(self, qubit: int, into: int) -> None:
        self.memory.set(into, self.qubits.measure(await self._qubit(qubit)))

    async def _meas_basis(self, qubit: int, into: int, *angles: int) -> None:
        await self._measure_turned(("rot_x", "rot_y", "rot_x"), qubit, into, angles)

    async def _meas_basis_yzy(self, qubit: int, into: int, *angles: int) -> None:
        await self._measure_turned(("rot_y", "rot_z", "rot_y"), qubit, into, angles)

    async def _meas_basis_zxz(self, qubit: int, into: int, *angles: int) -> None:
        await self._measure_turned(("rot_z", "rot_x", "rot_z"), qubit, into, angles)

    async def _measure_turned(
        self, axes: tuple[str, ...], qubit: int, into: int, angles: tuple[int, ...]
    ) -> None:
        number = await self._qubit(qubit)
        *numerators, denominator = angles
        for axis, numerator in zip(axes, numerators, strict=True):
            if numerator:
                self.qubits.rotate(axis, number, numerator, denominator)
        self.memory.set(into, self.qubits.measure(number))

    async def _create_epr(self, node: int, socket: int, qubits: int, words: int, into: int) -> None:
        what = self.memory.array(await self._known(words))
        where = await self._known(into)
        await self.qubits.flush()  # what comes before is done before
        numbers = self.memory.raw(qubits)
        self._ask(
            await self._known(node),
            await self._known(socket),
            numbers if isinstance(numbers, int) else None,
            list(what),
            where,
        )

    async def _recv_epr(self, node: int, socket: int, qubits: int, into: int) -> None:
        where, numbers = await self._known(into), self.memory.raw(qubits)
        await self.qubits.flush()
        peer, remote_socket = await self._known(node), await self._known(socket)
        pairs = numbers if isinstance(numbers, int) else None
        self._ask(peer, remote_socket, pairs, None, where)

    async def _wait_all(self, address: int, start: int, stop: int) -> None:
        await self._wait(address, start, stop, all)

    async def _wait_any(self, address: int, start: int, stop: int) -> None:
        await self._wait(address, start, stop, any)

    async def _wait_single(self, address: int, index: int) -> None:
        place = await self._known(index)
        await self._until(address, place, place + 1, all)

    async def _wait(
        self, address: int, start: int, stop: int, which: Callable[[list[bool]], bool]
    ) -> None:
        await self._until(address, await self._known(start), await self._known(stop), which)

    async def _until(
        self, address: int, start: int, stop: int, which: Callable[[list[bool]], bool]
    ) -> None:
        """Wait until entries of an array are defined."""
        await self.qubits.flush()
        await self._settled(
            lambda: which([each is not None for each in self.memory.part(address, start, stop)])
        )


def _told(name: int, held: Value | list[Value]) -> ReturnedArray | ReturnedRegister:
    if isinstance(held, list):
        return ReturnedArray(name, [_number(each) for each in held])
    value = _number(held)
    assert value is not None  # refused before
    return ReturnedRegister(name, value)


def _number(value: Value) -> int | None:
    return value.value if isinstance(value, Outcome) else value
