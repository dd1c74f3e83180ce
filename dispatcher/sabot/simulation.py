"""The interface of the simulation manager, in this process or another."""

from collections.abc import Sequence
from typing import Protocol

from dispatcher.sabot.backend import Angle, Bytes, GateName
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.kraus import Operators
from dispatcher.sabot.registers import Mask, Pick, Register


class Simulation(Protocol):
    """All quantum states of a network; `dispatcher.sabot.manager.Sabot` says what each does."""

    @property
    def backend(self) -> str: ...

    @property
    def live_qubits(self) -> int: ...

    @property
    def live_bytes(self) -> int: ...

    def simulated_by(self, *registers: Register) -> str: ...

    def zeros(self, count: int) -> Register: ...

    def bell_pairs(self, count: int) -> tuple[Register, Register]: ...

    def pauli(self, register: Register, paulis: Bytes) -> None: ...

    def require_capacity(self, register: Register, steps: Sequence[GateStep]) -> None: ...

    def gate(
        self,
        name: GateName,
        register: Register,
        target: Register | None = None,
        angle_rad: Angle = 0.0,
    ) -> None: ...

    def kraus(
        self, register: Register, operators: Operators, mask: Mask, draws: PhotonDraws
    ) -> None: ...

    def measure(self, register: Register, bases: Bytes, draws: PhotonDraws) -> Bytes: ...

    def bell_measure(
        self, first: Register, second: Register, draws: tuple[PhotonDraws, PhotonDraws]
    ) -> Bytes: ...

    def reset(self, register: Register, mask: Mask, draws: PhotonDraws) -> None: ...

    def drop(self, register: Register, draws: PhotonDraws) -> None: ...

    def lose(self, register: Register, lost: Mask) -> int: ...

    def part(self, register: Register, mask: Mask) -> Register: ...

    def gather(self, picks: Sequence[Pick]) -> Register: ...

    def explain(self, register: Register, place: str, photons: Bytes | Mask) -> None: ...

    def unite(self, register: Register, other: Register) -> None: ...
