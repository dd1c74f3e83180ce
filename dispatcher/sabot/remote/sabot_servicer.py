"""The Sabot server's gRPC service: one call is look up, check, act, reply."""

# gRPC names the methods.
# ruff: noqa: N802

import functools
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import grpc
import numpy as np
from numpy.typing import NDArray

from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot import limits
from dispatcher.sabot.backend import Backend, Generators
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import Dense, TooLarge
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import Component, Register, Share
from dispatcher.sabot.remote import requests
from dispatcher.sabot.remote.requests import Workspace, Workspaces
from dispatcher.timeouts import SIMULATOR_STOP_GRACE_S, SIMULATOR_STOP_TIMEOUT_S
from wire import sabot_pb2 as messages
from wire.config import BadConfig
from wire.dispatcher_service import MESSAGE_LIMITS
from wire.sabot_pb2 import DumpReply
from wire.sabot_pb2_grpc import SabotServicer, add_SabotServicer_to_server

LETTERS = "_XZY"


def dumped(
    workspace: Workspace, registers: Sequence[Register], members: int
) -> Iterator[DumpReply.State]:
    """Yield the states of the first members of registers, each state once."""
    seen: set[Component] = set()
    for register in registers:
        for share in list(register.shares):
            if share.component in seen:
                continue
            seen.add(share.component)
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
        registers = sabot.bell_pairs(request.count) if pairs else (sabot.zeros(request.count),)
        numbers = [workspace.add(register) for register in registers]
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
        workspace = self._workspaces.require(request.workspace)
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        workspace.sabot.reset(register, mask, requests.draws(request.draws, register))
        return _done(workspace)

    @call
    def Kraus(self, request: messages.KrausRequest) -> messages.Done:
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


MAX_SOCKET_PATH_BYTES = 100
MAX_WAITING_CALLS = 64


@contextmanager
def serving(socket: str, max_live_qubits: int) -> Iterator[None]:
    """Serve on a socket until the block is left; raise BadConfig if that cannot be."""
    if len(os.fsencode(socket)) > MAX_SOCKET_PATH_BYTES:
        raise BadConfig(f"socket {socket} is longer than {MAX_SOCKET_PATH_BYTES} bytes; shorten it")
    # One thread: calls wait for each other, as the states need it.
    with futures.ThreadPoolExecutor(max_workers=1) as pool:
        server = grpc.server(
            pool, options=MESSAGE_LIMITS, maximum_concurrent_rpcs=MAX_WAITING_CALLS
        )
        add_SabotServicer_to_server(SabotService(max_live_qubits), server)  # type: ignore[no-untyped-call]
        _bind(server, socket)
        server.start()
        try:
            yield
        finally:
            server.stop(SIMULATOR_STOP_GRACE_S).wait(SIMULATOR_STOP_TIMEOUT_S)
            Path(socket).unlink(missing_ok=True)


def serve(socket: str, max_live_qubits: int) -> None:
    stopped = threading.Event()
    with serving(socket, max_live_qubits):
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda _number, _frame: stopped.set())
        print("ready", flush=True)
        stopped.wait()


def _bind(server: grpc.Server, socket: str) -> None:
    before = os.umask(0o177)
    try:
        server.add_insecure_port(f"unix:{socket}")
    except RuntimeError as error:
        raise BadConfig(
            f"cannot listen on {socket}: is it in use, or its folder missing or not yours?"
        ) from error
    finally:
        os.umask(before)
