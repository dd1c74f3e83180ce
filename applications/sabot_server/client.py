"""The simulation manager in another process: each operation is a call over its Unix socket.

A call blocks the caller, as the work itself does when the manager is in this process. Lost photons
are known on this side, too, because the physical layer asks for it all the time.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

import grpc
import numpy as np

from applications.sabot_server.requests import packed_mask
from applications.timeouts import SIMULATION_TIMEOUT_S
from dispatcher.sabot.backend import Angle, Bytes, GateName
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.dense import TooLarge
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.gates import as_clifford
from dispatcher.sabot.kraus import Operators, of_qubits
from dispatcher.sabot.registers import Mask, Pick, Register
from wire import sabot_pb2 as messages
from wire.dispatcher_service import CHANNEL_OPTIONS
from wire.sabot_pb2_grpc import SabotStub

MAX_KRAUS_NUMBERS = 1 << 18  # of a request: 4 MiB, half of what a message may have


class SabotUnreachable(ConnectionError):
    """The Sabot server does not do what it should; the message names socket and remedy."""


@dataclass(eq=False, slots=True)
class RemoteRegister(Register):
    """A register that the server holds under a number."""

    number: int = 0


class RemoteSabot:
    """All quantum states of a network, held by a Sabot server."""

    def __init__(self, socket: str, backend: str) -> None:
        """Begin a workspace on a server; raise SabotUnreachable if there is none."""
        self._socket = socket
        self._channel = grpc.insecure_channel(f"unix:{socket}", CHANNEL_OPTIONS)
        self._stub = SabotStub(self._channel)  # type: ignore[no-untyped-call]
        self.backend = backend
        self._one_backend = backend == "chp"  # only gates that are not Clifford bring another
        self._done = messages.Done()
        begun = self._call(self._stub.Begin, messages.BeginRequest(backend=backend))
        self._workspace = int(begun.workspace)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        with suppress(SabotUnreachable):
            self._call(self._stub.End, messages.RegisterRequest(workspace=self._workspace))
        self._channel.close()

    @property
    def live_qubits(self) -> int:
        return self._done.live_qubits

    @property
    def live_bytes(self) -> int:
        return self._done.live_bytes

    def simulated_by(self, *registers: Register) -> str:
        if self._one_backend or not registers:
            return self.backend
        names: set[str] = set()
        for register in registers:
            request = messages.DumpRequest(workspace=self._workspace, registers=[_number(register)])
            names |= set(self._call(self._stub.Dump, request).backend.split("+"))
        return "+".join(sorted(names))

    def zeros(self, count: int) -> Register:
        (register,) = self._create(count, messages.CreateRequest.ZEROS)
        return register

    def bell_pairs(self, count: int) -> tuple[Register, Register]:
        first, second = self._create(count, messages.CreateRequest.BELL_PAIRS)
        return first, second

    def pauli(self, register: Register, paulis: Bytes) -> None:
        values = paulis.astype(np.uint8, copy=False).tobytes()
        self._apply(register, paulis=values)

    def require_capacity(self, register: Register, steps: Sequence[GateStep]) -> None:
        if self._one_backend and not any(map(_needs_vectors, steps)):
            return
        self._apply(register, gates=map(_gate, steps), check=True)

    def gate(
        self,
        name: GateName,
        register: Register,
        target: Register | None = None,
        angle_rad: Angle = 0.0,
    ) -> None:
        step = GateStep(name, target, angle_rad)
        self._apply(register, gates=[_gate(step)])
        if _needs_vectors(step):
            self._one_backend = False

    def measure(self, register: Register, bases: Bytes, draws: PhotonDraws) -> Bytes:
        self._ask("Measure", register, bases=bases.tobytes(), draws=_draws(draws))
        return self._outcomes()

    def bell_measure(
        self, first: Register, second: Register, draws: tuple[PhotonDraws, PhotonDraws]
    ) -> Bytes:
        drawn, others = map(_draws, draws)
        self._ask("BellMeasure", first, other=_number(second), draws=drawn, other_draws=others)
        return self._outcomes()

    def reset(self, register: Register, mask: Mask, draws: PhotonDraws) -> None:
        self._ask("Reset", register, mask=packed_mask(mask), draws=_draws(draws))

    def kraus(
        self, register: Register, operators: Operators, mask: Mask, draws: PhotonDraws
    ) -> None:
        count, met = operators.shape[-3], np.flatnonzero(mask)
        most = met.size if operators.ndim == 3 else MAX_KRAUS_NUMBERS // (4 * count)
        for start in range(0, met.size, max(most, 1)):
            some = met[start : start + most]
            part = np.zeros(register.size, dtype=bool)
            part[some] = True
            chosen = of_qubits(operators, some)
            request = messages.KrausRequest(
                workspace=self._workspace,
                register=_number(register),
                mask=packed_mask(part),
                operators=count,
                real=chosen.real.ravel(),
                imaginary=chosen.imag.ravel(),
                draws=_draws(draws),
            )
            self._done = self._call(self._stub.Kraus, request)

    def drop(self, register: Register, draws: PhotonDraws) -> None:
        self._ask("Drop", register, draws=_draws(draws))

    def lose(self, register: Register, lost: Mask) -> int:
        more = int(np.count_nonzero(register.present & lost))
        if more:
            self._ask("Lose", register, mask=packed_mask(lost))
        _mark_lost(register, lost)
        return more

    def part(self, register: Register, mask: Mask) -> Register:
        self._ask("Part", register, mask=packed_mask(mask))
        part = RemoteRegister(register.size, number=self._done.registers[0])
        part.lost = ~(register.present & mask)
        _mark_lost(register, mask)
        return part

    def gather(self, picks: Sequence[Pick]) -> Register:
        request = messages.GatherRequest(workspace=self._workspace)
        for register, positions in picks:
            request.picks.add(register=_number(register), positions=positions.tolist())
        self._done = self._call(self._stub.Gather, request)
        lost = np.concatenate([~pick.register.present[pick.positions] for pick in picks])
        for register, positions in picks:
            taken = np.zeros(register.size, dtype=bool)
            taken[positions] = True
            _mark_lost(register, taken)
        gathered = RemoteRegister(lost.size, number=self._done.registers[0])
        if lost.any():
            gathered.lost = lost
        return gathered

    def explain(self, register: Register, place: str, photons: Bytes | Mask) -> None:
        pass  # it changes nothing

    def unite(self, register: Register, other: Register) -> None:
        self._ask("Unite", register, other=_number(other))
        register.lost = ~(register.present | other.present)

    def _create(self, count: int, state: messages.CreateRequest.State) -> list[Register]:
        request = messages.CreateRequest(workspace=self._workspace, count=count, state=state)
        self._done = self._call(self._stub.Create, request)
        return [RemoteRegister(count, number=number) for number in self._done.registers]

    def _apply(
        self,
        register: Register,
        paulis: bytes = b"",
        gates: Iterable[messages.Gate] = (),
        check: bool = False,
    ) -> None:
        request = messages.ApplyRequest(
            workspace=self._workspace,
            register=_number(register),
            paulis=paulis,
            gates=gates,
            check=check,
        )
        self._done = self._call(self._stub.Apply, request)

    def _ask(self, method: str, register: Register, **fields: Any) -> None:
        request = messages.RegisterRequest(
            workspace=self._workspace, register=_number(register), **fields
        )
        self._done = self._call(getattr(self._stub, method), request)

    def _outcomes(self) -> Bytes:
        return np.frombuffer(self._done.outcomes, dtype=np.uint8).copy()

    def _call(self, method: Callable[..., Any], request: object) -> Any:
        try:
            return method(request, timeout=SIMULATION_TIMEOUT_S)
        except grpc.RpcError as error:
            if error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED:
                raise TooLarge(error.details()) from error
            raise SabotUnreachable(
                f"the Sabot server at {self._socket}: {error.details()}; start it with "
                f"python -m dispatcher.sabot --socket {self._socket}"
            ) from error


def _gate(step: GateStep) -> messages.Gate:
    target = _number(step.target) if step.target is not None else 0
    gate = messages.Gate(name=step.name, target=target)
    if isinstance(step.angle_rad, np.ndarray):
        gate.angles_rad.extend(step.angle_rad.tolist())
    else:
        gate.angle_rad = step.angle_rad
    return gate


def _needs_vectors(step: GateStep) -> bool:
    return as_clifford(step.name, step.angle_rad) is None


def _draws(draws: PhotonDraws) -> messages.Draws:
    if draws.name is None:
        return messages.Draws(bits=draws.bits().tobytes(), fractions=draws.fractions())
    session, number, half = draws.name.key
    return messages.Draws(
        seed=str(draws.name.seed),
        session=session,
        number=number,
        half=half,
        purpose=draws.name.purpose,
    )


def _number(register: Register) -> int:
    assert isinstance(register, RemoteRegister)
    return register.number


def _mark_lost(register: Register, lost: Mask) -> None:
    register.lost = lost.copy() if register.lost is None else register.lost | lost
