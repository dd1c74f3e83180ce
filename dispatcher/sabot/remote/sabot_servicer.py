"""The Sabot server's gRPC service: one call is look up, check, act, reply."""

# gRPC names the methods.
# ruff: noqa: N802

import functools
from collections.abc import Callable
from typing import Any, TypeVar

from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot import limits
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import TooLarge
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.remote import requests
from dispatcher.sabot.remote.states import dumped
from dispatcher.sabot.remote.workspace import Workspace, Workspaces
from wire import sabot_pb2 as messages
from wire.sabot_pb2_grpc import SabotServicer

Request = TypeVar("Request")
Reply = TypeVar("Reply")
MAX_DUMPED_MEMBERS = 64
MAX_DUMPED_REGISTERS = 64


def call(
    method: Callable[["SabotService", Request], Reply],
) -> Callable[["SabotService", Request, Any], Reply]:
    @functools.wraps(method)
    def answer(service: "SabotService", request: Request, context: Any) -> Reply:
        try:
            try:
                return method(service, request)
            except TooLarge as error:
                raise exhausted(str(error)) from error
        except Refusal as refusal:
            context.abort(refusal.code, str(refusal))
            raise  # abort has raised already

    return answer


class SabotService(SabotServicer):
    """Serves workspaces; calls come one at a time."""

    def __init__(self, max_live_qubits: int) -> None:
        """Hold at most so many qubits."""
        self._workspaces = Workspaces(max_live_qubits)

    @call
    def Begin(self, request: messages.BeginRequest) -> messages.BeginReply:
        if request.backend not in BACKENDS:
            raise invalid(
                f"backend {request.backend!r} is unknown; use one of {', '.join(sorted(BACKENDS))}"
            )
        sabot = Sabot(BACKENDS[request.backend])
        return messages.BeginReply(workspace=self._workspaces.begin(sabot))

    @call
    def End(self, request: messages.EndRequest) -> messages.Done:
        self._workspaces.end(request.workspace)
        return messages.Done()

    @call
    def Create(self, request: messages.CreateRequest) -> messages.CreateReply:
        workspace = self._workspaces.require(request.workspace)
        limits.require_count(request.count)
        if request.state not in messages.CreateRequest.State.values():
            raise invalid(f"state {request.state} is unknown; use ZEROS or BELL_PAIRS")
        pairs = request.state == messages.CreateRequest.BELL_PAIRS
        self._workspaces.require_capacity(request.count * (1 + pairs))
        workspace.require_place(1 + pairs)
        sabot = workspace.sabot
        made = sabot.bell_pairs(request.count) if pairs else (sabot.zeros(request.count),)
        numbers = [workspace.add(register) for register in made]
        return messages.CreateReply(registers=numbers, done=_done(workspace))

    @call
    def Apply(self, request: messages.ApplyRequest) -> messages.Done:
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        paulis = requests.paulis(request.paulis, register)
        steps = requests.steps(workspace, register, request.gates)
        workspace.sabot.require_capacity(register, steps)
        if request.check:
            return _done(workspace)
        if paulis is not None:
            workspace.sabot.pauli(register, paulis)
        for step in steps:
            workspace.sabot.gate(step.name, register, step.target, step.angle_rad)
        return _done(workspace)

    @call
    def Measure(self, request: messages.MeasureRequest) -> messages.Outcomes:
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        bases = requests.bases(request.bases, register)
        draws = requests.draws(request.draws, register)
        outcomes = workspace.sabot.measure(register, bases, draws)
        workspace.remove(request.register)
        return messages.Outcomes(outcomes=outcomes.tobytes(), done=_done(workspace))

    @call
    def BellMeasure(self, request: messages.BellMeasureRequest) -> messages.Outcomes:
        workspace = self._workspaces.require(request.workspace)
        first, second = (workspace.require(n) for n in (request.first, request.second))
        requests.require_pair(first, second)
        draws = (
            requests.draws(request.first_draws, first),
            requests.draws(request.second_draws, second),
        )
        outcomes = workspace.sabot.bell_measure(first, second, draws)
        workspace.remove(request.first)
        workspace.remove(request.second)
        return messages.Outcomes(outcomes=outcomes.tobytes(), done=_done(workspace))

    @call
    def Reset(self, request: messages.ResetRequest) -> messages.Done:
        """Put qubits into |0>."""
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        workspace.sabot.reset(register, mask, requests.draws(request.draws, register))
        return _done(workspace)

    @call
    def Kraus(self, request: messages.KrausRequest) -> messages.Done:
        """Let a channel act on qubits."""
        workspace = self._workspaces.require(request.workspace)
        requests.require_vectors(workspace)
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        operators = requests.operators(request, mask)
        draws = requests.draws(request.draws, register)
        workspace.sabot.kraus(register, operators, mask, draws)
        return _done(workspace)

    @call
    def Lose(self, request: messages.LoseRequest) -> messages.Done:
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        workspace.sabot.lose(register, requests.mask(request.mask, register))
        return _done(workspace)

    @call
    def Part(self, request: messages.PartRequest) -> messages.CreateReply:
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        workspace.require_place(1)
        number = workspace.add(workspace.sabot.part(register, mask))
        return messages.CreateReply(registers=[number], done=_done(workspace))

    @call
    def Unite(self, request: messages.UniteRequest) -> messages.Done:
        workspace = self._workspaces.require(request.workspace)
        register, other = (workspace.require(n) for n in (request.register, request.other))
        requests.require_parts(register, other)
        workspace.sabot.unite(register, other)
        workspace.remove(request.other)
        return _done(workspace)

    @call
    def Gather(self, request: messages.GatherRequest) -> messages.CreateReply:
        workspace = self._workspaces.require(request.workspace)
        picks = requests.picks(workspace, request.picks)
        workspace.require_place(1)
        number = workspace.add(workspace.sabot.gather(picks))
        return messages.CreateReply(registers=[number], done=_done(workspace))

    @call
    def Drop(self, request: messages.DropRequest) -> messages.Done:
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        workspace.sabot.drop(register, requests.draws(request.draws, register))
        workspace.remove(request.register)
        return _done(workspace)

    @call
    def Dump(self, request: messages.DumpRequest) -> messages.DumpReply:
        """Say what the states are, and which backends hold them."""
        workspace = self._workspaces.require(request.workspace)
        if request.members > MAX_DUMPED_MEMBERS:
            raise invalid(f"members {request.members}; at most {MAX_DUMPED_MEMBERS} are dumped")
        if not 1 <= len(request.registers) <= MAX_DUMPED_REGISTERS:
            raise invalid(
                f"{len(request.registers)} registers; name 1 to {MAX_DUMPED_REGISTERS} of them"
            )
        registers = [workspace.require(number) for number in request.registers]
        if len({register.size for register in registers}) > 1:
            raise invalid("the registers have different sizes; dump those of one size together")
        return messages.DumpReply(
            backend=workspace.sabot.simulated_by(*registers),
            states=dumped(workspace, registers, request.members),
            done=_done(workspace),
        )


def _done(workspace: Workspace) -> messages.Done:
    sabot = workspace.sabot
    return messages.Done(live_qubits=sabot.live_qubits, live_bytes=sabot.live_bytes)
