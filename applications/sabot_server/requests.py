"""Requests to the Sabot server: decoded whole or refused, nothing changed."""

import re
from collections.abc import Sequence
from itertools import count
from typing import cast, get_args

import numpy as np

from dispatcher.refusal import exhausted, invalid, not_found
from dispatcher.sabot import limits
from dispatcher.sabot.backend import Angle, Bytes, GateName
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.draws import Draws, PhotonDraws
from dispatcher.sabot.gates import ROTATIONS, TWO_QUBIT_GATES
from dispatcher.sabot.kraus import MOST_OPERATORS, Operators, wrong_with
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import Mask, Pick, Register
from wire import sabot_pb2 as messages
from wire.outcomes import BASES

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
        register = self._registers.get(number)
        if register is None:
            raise not_found(f"no register {number} in this workspace; create it first")
        return register

    def require_place(self, more: int) -> None:
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
    def __init__(self, max_live_qubits: int) -> None:
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
        workspace = self._all.get(number)
        if workspace is None:
            raise not_found(f"no workspace {number}; begin one first")
        return workspace

    def require_capacity(self, more: int) -> None:
        live = sum(workspace.sabot.live_qubits for workspace in self._all.values())
        if live + more > self._max_live_qubits:
            raise exhausted(
                f"{more} more qubits with {live} live exceed the limit of "
                f"{self._max_live_qubits}; measure or drop some first"
            )


SEED = re.compile(r"-?\d{1,100}")
MAX_PURPOSE = 200  # letters
GATE_NAMES = get_args(GateName)


def mask(packed: bytes, register: Register) -> Mask:
    """Return which qubits of a register are meant, from one bit for each."""
    if len(packed) != (register.size + 7) // 8:
        raise invalid(
            f"mask has {len(packed)} bytes for {register.size} qubits; send one bit for each"
        )
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), bitorder="little")
    if bits[register.size :].any():
        raise invalid("the mask has bits behind its last qubit; make them 0")
    return bits[: register.size].astype(bool)


def packed_mask(bits: Mask) -> bytes:
    """Return one bit for each qubit."""
    return np.packbits(bits, bitorder="little").tobytes()


def bases(values: bytes, register: Register) -> Bytes:
    if not values:
        return np.zeros(register.size, dtype=np.uint8)
    return limits.packed("bases", values, register.size, len(BASES) - 1)


def paulis(values: bytes, register: Register) -> Bytes | None:
    return limits.packed("paulis", values, register.size, 3) if values else None


def draws(named: messages.Draws, register: Register) -> PhotonDraws:
    if named.bits:
        return _given(named, register.size)
    if not SEED.fullmatch(named.seed):
        seed = named.seed[:MAX_PURPOSE]
        raise invalid(f"seed {seed!r} is not a whole number of up to 100 digits")
    if len(named.purpose) > MAX_PURPOSE:
        raise invalid(f"a purpose of {len(named.purpose)} letters; use at most {MAX_PURPOSE}")
    key = (named.session, named.number, named.half)
    return Draws(int(named.seed)).photons(key, named.purpose, register.size)


def _given(numbers: messages.Draws, count: int) -> PhotonDraws:
    bits, fractions = limits.packed("bits", numbers.bits, count, 1), np.array(numbers.fractions)
    if fractions.size != count or not ((fractions >= 0) & (fractions < 1)).all():
        raise invalid(f"{fractions.size} fractions for {count} qubits; send one from 0 to 1 each")
    return PhotonDraws(bits.copy, lambda: fractions)


def steps(
    workspace: Workspace, register: Register, gates: Sequence[messages.Gate]
) -> list[GateStep]:
    """Return what the manager is asked; each register must be there and pair up."""
    if len(gates) > limits.MAX_GATES:
        raise invalid(f"{len(gates)} gates; send at most {limits.MAX_GATES} in a request")
    return [_step(workspace, register, gate) for gate in gates]


def _step(workspace: Workspace, register: Register, gate: messages.Gate) -> GateStep:
    if gate.name not in GATE_NAMES:
        names = ", ".join(GATE_NAMES)
        raise invalid(f"gate {gate.name[:MAX_PURPOSE]!r} is unknown; use one of {names}")
    name = cast(GateName, gate.name)
    angle_rad = _angle(name, gate, register) if name in ROTATIONS else 0.0
    if name not in TWO_QUBIT_GATES:
        return GateStep(name, None, angle_rad)
    target = workspace.require(gate.target)
    require_pair(register, target)
    return GateStep(name, target, angle_rad)


def _angle(name: str, gate: messages.Gate, register: Register) -> Angle:
    angles = np.array(gate.angles_rad or [gate.angle_rad])
    if not np.isfinite(angles).all():
        wrong = angles[~np.isfinite(angles)][0]
        raise invalid(f"angle_rad {wrong} of {name} is not finite; send a number")
    if not gate.angles_rad:
        return gate.angle_rad
    if angles.size != register.size:
        raise invalid(f"{angles.size} angles of {name} for {register.size} qubits; send one each")
    return angles


def require_vectors(workspace: Workspace) -> None:
    """Refuse what needs state vectors where states need not be any."""
    backend = workspace.sabot.backend
    if backend != Dense.NAME:
        raise invalid(f"Kraus operators on backend {backend}; begin a workspace on {Dense.NAME}")


def operators(request: messages.KrausRequest, mask: Mask) -> Operators:
    """Return the Kraus operators of all qubits, or those of each; where none are meant, 1."""
    count, length = request.operators, len(request.real)
    met = int(np.count_nonzero(mask))
    if not 1 <= count <= MOST_OPERATORS:
        raise invalid(f"operators {count}; send 1 to {MOST_OPERATORS}")
    if not length or len(request.imaginary) != length or length not in (4 * count, 4 * count * met):
        raise invalid(
            f"{length} real and {len(request.imaginary)} imaginary numbers for {count} operators "
            f"on {met} qubits; send 4 for each operator, of all qubits or of each"
        )
    values = np.array(request.real) + 1j * np.array(request.imaginary)
    alike = length == 4 * count
    kraus: Operators = values.reshape((count, 2, 2) if alike else (met, count, 2, 2))
    if (wrong := wrong_with(kraus, met)) is not None:
        raise invalid(f"Kraus operators: {wrong}; send those of a channel")
    if alike:
        return kraus
    every = np.zeros((mask.size, count, 2, 2), dtype=np.complex128)
    every[:, 0] = np.eye(2)
    every[mask] = kraus
    return every


def picks(workspace: Workspace, picked: Sequence[messages.GatherRequest.Pick]) -> list[Pick]:
    """Return the qubits that are picked: of registers and at positions named once each."""
    result: list[Pick] = []
    for pick in picked:
        register = workspace.require(pick.register)
        if any(register is other.register for other in result):
            raise invalid(f"register {pick.register} is picked twice; pick all of it at once")
        positions = np.fromiter(pick.positions, np.uint32, len(pick.positions))
        limits.require_positions("positions", positions, register.size)
        result.append(Pick(register, positions))
    limits.require_count(sum(pick.positions.size for pick in result))
    return result


def require_pair(first: Register, second: Register) -> None:
    if first is second:
        raise invalid("a register is named twice; name two different ones")
    if first.size != second.size:
        raise invalid(
            f"registers of {first.size} and {second.size} qubits; their qubits must pair up"
        )


def require_parts(register: Register, other: Register) -> None:
    require_pair(register, other)
    if register.lost is None or ((register.labels() >= 0) & (other.labels() >= 0)).any():
        raise invalid("these registers are not two parts of one; unite what Part has parted")
