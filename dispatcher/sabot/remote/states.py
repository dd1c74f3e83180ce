"""Quantum states as they are dumped: stabilizers as text, amplitudes of state vectors."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backend import Backend, Generators
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.registers import Component, Register, Share
from dispatcher.sabot.remote.workspace import Workspace
from wire.sabot_pb2 import DumpReply

LETTERS = "_XZY"


def dumped(
    workspace: Workspace, registers: Sequence[Register], members: int
) -> Iterator[DumpReply.State]:
    """Yield the states of the first members of registers, each state once."""
    known: set[Component] = set()
    for register in registers:
        for share in list(register.shares):
            if share.component in known:
                continue
            known.add(share.component)
            places = [_positions(own) for own in share.component.shares]
            here = _positions(share)
            for member in np.flatnonzero(here < members):
                reply = _state(share.component, int(member))
                reply.position = int(here[member])
                reply.positions.extend(int(own[member]) for own in places)
                reply.registers.extend(map(workspace.number, _registers(share.component)))
                yield reply


def _positions(share: Share) -> NDArray[np.uint32]:
    return np.arange(share.register.size, dtype=np.uint32)[share.positions]


def _registers(component: Component) -> list[Register]:
    return [share.register for share in component.shares]


def _state(component: Component, member: int) -> DumpReply.State:
    state = component.state
    reply = DumpReply.State(backend=state.NAME)
    if isinstance(state, Dense):
        amplitudes = state.take(np.array([member])).amplitudes[0]
        reply.real.extend(amplitudes.real.tolist())
        reply.imaginary.extend(amplitudes.imag.tolist())
    else:
        reply.stabilizers = stabilizers(state, member)
    return reply


def stabilizers(state: Backend, member: int) -> str:
    generators: Generators = state.generators()
    lines = []
    for x, z, signs in zip(generators.x, generators.z, generators.signs, strict=True):
        letters = (LETTERS[letter] for letter in x.astype(int) + 2 * z.astype(int))
        lines.append(("-" if signs[member] else "+") + "".join(letters))
    return "\n".join(lines)
