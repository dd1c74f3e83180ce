"""A simulation manager that passes everything on to another and writes it down."""

from collections.abc import Iterator, Sequence
from functools import reduce
from operator import xor

import numpy as np

from dispatcher.layer.journal import origin
from dispatcher.recording.writer import Chunk, QasmWriter
from dispatcher.sabot.backend import Angle, Bytes, GateName
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.gates import ROTATIONS
from dispatcher.sabot.kraus import Operators
from dispatcher.sabot.registers import Mask, Pick, Register
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import BELL_STATES, NO_CLICK
from wire.outcomes import PAULIS as PAULI_NAMES

# As the file writes Paulis, bases and gates. XZ is Z first; its phase cannot be seen.
PAULIS = ("", "x {0};", "z {0};", "z {0}; x {0};")
BASES = ("", "h {0}; ", "sdg {0}; h {0}; ", "ry(-pi/4) {0}; ", "ry(pi/4) {0}; ")
GATES: dict[GateName, str] = {
    **{name: f"{name.lower()} {{0}};" for name in ("H", "S", "T")},
    "S_DAG": "sdg {0};",
    "T_DAG": "tdg {0};",
    "CX": "cx {0}, {1};",
    "CZ": "cz {0}, {1};",
    **{name: f"{name.lower()}({{2!r}}) {{0}};" for name in ROTATIONS},
}
DIFFERS = "what is found of them later may differ"
UNWRITTEN = f"with a photon that is not written: {DIFFERS}"


class TracedSabot:
    """Does what the inner one does; `dispatcher.sabot.manager.Sabot` says what that is."""

    def __init__(self, inner: Simulation, writer: QasmWriter) -> None:
        self._inner, self._writer = inner, writer
        # Which qubit of which chunk each photon is that is written, by its position.
        self._traced: dict[Register, dict[int, tuple[Chunk, int]]] = {}
        # Where what will be done to photons comes from, and which Pauli that is.
        self._places: dict[Register, dict[int, list[tuple[str, int]]]] = {}

    @property
    def backend(self) -> str:
        return self._inner.backend

    @property
    def live_qubits(self) -> int:
        return self._inner.live_qubits

    @property
    def live_bytes(self) -> int:
        return self._inner.live_bytes

    def simulated_by(self, *registers: Register) -> str:
        return self._inner.simulated_by(*registers)

    def require_capacity(self, register: Register, steps: Sequence[GateStep]) -> None:
        self._inner.require_capacity(register, steps)

    def zeros(self, count: int) -> Register:
        register = self._inner.zeros(count)
        self._begin([register])
        return register

    def bell_pairs(self, count: int) -> tuple[Register, Register]:
        first, second = self._inner.bell_pairs(count)
        self._begin([first, second])
        for position, one in self._present(first):
            other = self._name(second, position)
            self._writer.line(f"h {one}; cx {one}, {other};", f"pair {position}")
        return first, second

    def pauli(self, register: Register, paulis: Bytes) -> None:
        self._inner.pauli(register, paulis)
        for position, qubit in self._present(register):
            self._write_pauli(register, position, qubit, int(paulis[position]))

    def gate(
        self,
        name: GateName,
        register: Register,
        target: Register | None = None,
        angle_rad: Angle = 0.0,
    ) -> None:
        self._inner.gate(name, register, target, angle_rad)
        if target is not None:
            self._write_pairs(name, register, target)
            return
        for position, qubit in self._present(register):
            angle = angle_rad[position] if isinstance(angle_rad, np.ndarray) else angle_rad
            text = GATES[name].format(qubit, "", float(angle))
            self._writer.line(text, self._comment(position))

    def measure(self, register: Register, bases: Bytes, draws: PhotonDraws) -> Bytes:
        outcomes = self._inner.measure(register, bases, draws)
        if register in self._traced:
            bits = self._writer.bits(len(self._traced[register]), origin())
            for index, (position, qubit) in enumerate(self._all(register)):
                if outcomes[position] == NO_CLICK:
                    self._writer.comment(f"photon {position}: no click")
                    continue
                text = f"{BASES[bases[position]].format(qubit)}measure {qubit} -> {bits}[{index}];"
                self._writer.line(text, f"photon {position}: {outcomes[position]}")
        self._end(register)
        return outcomes

    def bell_measure(
        self, first: Register, second: Register, draws: tuple[PhotonDraws, PhotonDraws]
    ) -> Bytes:
        outcomes = self._inner.bell_measure(first, second, draws)
        common = self._traced.get(first, {}).keys() & self._traced.get(second, {}).keys()
        if common:
            self._write_bell(first, second, sorted(common), outcomes)
        self._end(first)
        self._end(second)
        return outcomes

    def reset(self, register: Register, mask: Mask, draws: PhotonDraws) -> None:
        self._inner.reset(register, mask, draws)
        for position, qubit in self._present(register):
            if mask[position]:
                self._writer.line(f"reset {qubit};", self._comment(position))

    def kraus(
        self, register: Register, operators: Operators, mask: Mask, draws: PhotonDraws
    ) -> None:
        self._inner.kraus(register, operators, mask, draws)
        for position, _qubit in self._present(register):
            if mask[position]:
                self._writer.comment(
                    f"{self._comment(position)}: Kraus operators, not written: {DIFFERS}"
                )

    def drop(self, register: Register, draws: PhotonDraws) -> None:
        self._inner.drop(register, draws)
        if register in self._traced:
            self._writer.comment(f"{origin()}: {len(self._traced[register])} photons are discarded")
        self._end(register)

    def lose(self, register: Register, lost: Mask) -> int:
        gone = [(position, q) for position, q in self._present(register) if lost[position]]
        for position, qubit in gone:
            places = self._places.get(register, {}).pop(position, [])
            where = places[-1][0] if places else origin()  # what came before it was in vain
            self._writer.line(f"reset {qubit};", f"photon {position}, lost: {where}")
        return self._inner.lose(register, lost)

    def explain(self, register: Register, place: str, photons: Bytes | Mask) -> None:
        for position, _qubit in self._present(register):
            if photons[position]:
                places = self._places.setdefault(register, {})
                places.setdefault(position, []).append((place, int(photons[position])))

    def part(self, register: Register, mask: Mask) -> Register:
        part = self._inner.part(register, mask)
        if register in self._traced:
            chunks = self._traced[register]
            self._traced[part] = {p: chunks.pop(p) for p in list(chunks) if mask[p]}
            self._places.pop(register, None)
        return part

    def unite(self, register: Register, other: Register) -> None:
        self._inner.unite(register, other)
        if other in self._traced:
            self._traced.setdefault(register, {}).update(self._traced.pop(other))

    def gather(self, picks: Sequence[Pick]) -> Register:
        gathered = self._inner.gather(picks)
        chunks: dict[int, tuple[Chunk, int]] = {}
        start = 0
        for register, positions in picks:
            traced = self._traced.get(register, {})
            self._places.pop(register, None)
            traced_places = np.flatnonzero(
                np.isin(positions, np.array(list(traced), dtype=np.uint32))
            )
            chunks |= {
                start + int(place): traced.pop(int(positions[place])) for place in traced_places
            }
            start += positions.size
        if chunks:
            self._traced[gathered] = chunks
        return gathered

    def _begin(self, registers: list[Register]) -> None:
        count = registers[0].size
        chunks = self._writer.begin((r.size for r in registers), f"{origin()}: {count} systems")
        for register, chunk in zip(registers, chunks or (), strict=False):
            self._traced[register] = {index: (chunk, index) for index in range(chunk.size)}

    def _end(self, register: Register) -> None:
        self._places.pop(register, None)
        for chunk, index in self._traced.pop(register, {}).values():
            chunk.live.discard(index)

    def _write_pairs(self, name: GateName, register: Register, target: Register) -> None:
        """Write a gate for each pair; say where only one photon of a pair is written."""
        controls, targets = dict(self._present(register)), dict(self._present(target))
        both = register.present & target.present
        for position in sorted(controls.keys() | targets.keys()):
            if not both[position]:
                continue
            if position in controls and position in targets:
                text = GATES[name].format(controls[position], targets[position])
                self._writer.line(text, self._comment(position))
            else:
                self._writer.comment(f"{self._comment(position)}: {name} {UNWRITTEN}")

    def _write_bell(
        self, first: Register, second: Register, positions: list[int], outcomes: Bytes
    ) -> None:
        phases = self._writer.bits(len(positions), f"{origin()}, 1: a phase flip")
        flips = self._writer.bits(len(positions), f"{origin()}, 1: a bit flip")
        for index, position in enumerate(positions):
            if outcomes[position] == NO_CLICK:
                self._writer.comment(f"pair {position}: no coincidence")
                continue
            one, other = self._name(first, position), self._name(second, position)
            text = f"cx {one}, {other}; h {one}; measure {other} -> {flips}[{index}]; "
            text += f"measure {one} -> {phases}[{index}];"
            outcome = int(outcomes[position])
            self._writer.line(text, f"pair {position}: {BELL_STATES[outcome]}, {outcome:02b}")

    def _all(self, register: Register) -> Iterator[tuple[int, str]]:
        for position in sorted(self._traced.get(register, ())):
            yield position, self._name(register, position)

    def _present(self, register: Register) -> Iterator[tuple[int, str]]:
        if register in self._traced:
            present = register.present
            yield from ((p, qubit) for p, qubit in self._all(register) if present[p])

    def _name(self, register: Register, position: int) -> str:
        chunk, index = self._traced[register][position]
        return chunk.qubit(index)

    def _write_pauli(self, register: Register, position: int, qubit: str, pauli: int) -> None:
        places = self._places.get(register, {})
        explained = places.get(position, [])
        if explained and pauli == reduce(xor, (value for _place, value in explained)):
            del places[position]
            text = ", ".join(f"{PAULI_NAMES[value]}: {place}" for place, value in explained)
            comment = f"photon {position}, {text}"
        else:
            comment = self._comment(position)
        if pauli:
            self._writer.line(PAULIS[pauli].format(qubit), comment)
        elif explained and position not in places:
            self._writer.comment(f"{comment}: nothing together")

    @staticmethod
    def _comment(position: int) -> str:
        return f"photon {position}, {origin()}"
