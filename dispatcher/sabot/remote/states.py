"""Quantum states as they are dumped: stabilizers as text, amplitudes of state vectors."""

from collections.abc import Iterator, Sequence

import numpy as np

from dispatcher.sabot.backend import Backend, Generators
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.registers import Component, Register
from dispatcher.sabot.remote.workspace import Workspace
from wire.sabot_pb2 import DumpReply

LETTERS = "_XZY"


def dumped(
    workspace: Workspace, registers: Sequence[Register], members: int
) -> Iterator[DumpReply.State]:
    """Yield the states of the first members of registers, each state once."""
    components = {c: None for register in registers for c in register.components}
    for component in components:
        positions = np.arange(registers[0].size, dtype=np.uint32)[component.positions]
        for member in np.flatnonzero(positions < members):
            numbers = [workspace.number(register) for register in component.registers]
            yield _state(component, int(member), int(positions[member]), numbers)


def _state(component: Component, member: int, position: int, numbers: list[int]) -> DumpReply.State:
    state = component.state
    reply = DumpReply.State(position=position, registers=numbers, backend=state.NAME)
    if isinstance(state, Dense):
        amplitudes = state.take(np.array([member])).amplitudes[0]
        reply.real.extend(amplitudes.real.tolist())
        reply.imaginary.extend(amplitudes.imag.tolist())
    else:
        reply.stabilizers = stabilizers(state, member)
    return reply


def stabilizers(state: Backend, member: int) -> str:
    """Return the stabilizers of a member, one a line, such as +XX."""
    generators: Generators = state.generators()
    lines = []
    for x, z, signs in zip(generators.x, generators.z, generators.signs, strict=True):
        letters = (LETTERS[letter] for letter in x.astype(int) + 2 * z.astype(int))
        lines.append(("-" if signs[member] else "+") + "".join(letters))
    return "\n".join(lines)
