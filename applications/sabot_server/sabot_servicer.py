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
from typing import Any

import grpc
import numpy as np
from numpy.typing import NDArray

from applications.sabot_server import requests
from applications.sabot_server.requests import Workspace, Workspaces
from applications.timeouts import SIMULATOR_STOP_GRACE_S, SIMULATOR_STOP_TIMEOUT_S
from dispatcher.refusal import Refusal, invalid
from dispatcher.sabot import limits
from dispatcher.sabot.backend import Backend, Generators
from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.dense import Dense, TooLarge
from dispatcher.sabot.manager import Sabot
from dispatcher.sabot.registers import Component, Register, Share
from wire import sabot_pb2 as messages
from wire.config import BadConfig
from wire.dispatcher_service import MESSAGE_LIMITS
from wire.sabot_pb2 import DumpReply, RegisterRequest
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
            places = [_positions(places_of) for places_of in share.component.shares]
            here = _positions(share)
            for member in np.flatnonzero(here < members):
                reply = _state(share.component, int(member))
                reply.position = int(here[member])
                reply.positions.extend(int(places_of[member]) for places_of in places)
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


MAX_DUMPED_MEMBERS = 64
MAX_DUMPED_REGISTERS = 64
Reply = messages.Done | DumpReply


@contextmanager
def refusing(context: Any) -> Iterator[None]:
    """Answer refusals with their gRPC status."""
    try:
        yield
    except TooLarge as error:
        context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, str(error))
        raise  # abort has raised already
    except Refusal as refusal:
        context.abort(refusal.code, str(refusal))
        raise


def call(
    method: Callable[["SabotService", Workspace, Any], Reply | None],
) -> Callable[["SabotService", Any, Any], Reply]:
    """Look up the workspace of a request, and say in the reply how much is live there."""

    @functools.wraps(method)
    def answer(service: "SabotService", request: Any, context: Any) -> Reply:
        with refusing(context):
            workspace = service.workspaces.require(request.workspace)
            reply = method(service, workspace, request) or messages.Done()
            done = reply.done if isinstance(reply, DumpReply) else reply
            done.live_qubits = workspace.sabot.live_qubits
            done.live_bytes = workspace.sabot.live_bytes
            return reply

    return answer


class SabotService(SabotServicer):
    """Serves workspaces; calls come one at a time."""

    def __init__(self, max_live_qubits: int) -> None:
        self.workspaces = Workspaces(max_live_qubits)

    def Begin(self, request: messages.BeginRequest, context: Any) -> messages.BeginReply:
        with refusing(context):
            if request.backend not in BACKENDS:
                names = ", ".join(sorted(BACKENDS))
                raise invalid(f"backend {request.backend!r} is unknown; use one of {names}")
            sabot = Sabot(BACKENDS[request.backend])
            return messages.BeginReply(workspace=self.workspaces.begin(sabot))

    @call
    def End(self, _workspace: Workspace, request: RegisterRequest) -> None:
        self.workspaces.end(request.workspace)

    @call
    def Create(self, workspace: Workspace, request: messages.CreateRequest) -> messages.Done:
        limits.require_count(request.count)
        if request.state not in messages.CreateRequest.State.values():
            raise invalid(f"state {request.state} is unknown; use ZEROS or BELL_PAIRS")
        pairs = request.state == messages.CreateRequest.BELL_PAIRS
        self.workspaces.require_capacity(request.count * (1 + pairs))
        workspace.require_place(1 + pairs)
        sabot = workspace.sabot
        registers = sabot.bell_pairs(request.count) if pairs else (sabot.zeros(request.count),)
        return messages.Done(registers=map(workspace.add, registers))

    @call
    def Apply(self, workspace: Workspace, request: messages.ApplyRequest) -> None:
        register = workspace.require(request.register)
        paulis = requests.paulis(request.paulis, register)
        steps = requests.steps(workspace, register, request.gates)
        workspace.sabot.require_capacity(register, steps)
        if request.check:
            return
        if paulis is not None:
            workspace.sabot.pauli(register, paulis)
        for step in steps:
            workspace.sabot.gate(step.name, register, step.target, step.angle_rad)

    @call
    def Measure(self, workspace: Workspace, request: RegisterRequest) -> messages.Done:
        register = workspace.require(request.register)
        bases = requests.bases(request.bases, register)
        draws = requests.draws(request.draws, register)
        outcomes = workspace.sabot.measure(register, bases, draws)
        workspace.remove(request.register)
        return messages.Done(outcomes=outcomes.tobytes())

    @call
    def BellMeasure(self, workspace: Workspace, request: RegisterRequest) -> messages.Done:
        first, second = (workspace.require(n) for n in (request.register, request.other))
        requests.require_pair(first, second)
        draws = (
            requests.draws(request.draws, first),
            requests.draws(request.other_draws, second),
        )
        outcomes = workspace.sabot.bell_measure(first, second, draws)
        workspace.remove(request.register)
        workspace.remove(request.other)
        return messages.Done(outcomes=outcomes.tobytes())

    @call
    def Reset(self, workspace: Workspace, request: RegisterRequest) -> None:
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        workspace.sabot.reset(register, mask, requests.draws(request.draws, register))

    @call
    def Kraus(self, workspace: Workspace, request: messages.KrausRequest) -> None:
        requests.require_vectors(workspace)
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        operators = requests.operators(request, mask)
        draws = requests.draws(request.draws, register)
        workspace.sabot.kraus(register, operators, mask, draws)

    @call
    def Lose(self, workspace: Workspace, request: RegisterRequest) -> None:
        register = workspace.require(request.register)
        workspace.sabot.lose(register, requests.mask(request.mask, register))

    @call
    def Part(self, workspace: Workspace, request: RegisterRequest) -> messages.Done:
        register = workspace.require(request.register)
        mask = requests.mask(request.mask, register)
        workspace.require_place(1)
        return messages.Done(registers=[workspace.add(workspace.sabot.part(register, mask))])

    @call
    def Unite(self, workspace: Workspace, request: RegisterRequest) -> None:
        register, other = (workspace.require(n) for n in (request.register, request.other))
        requests.require_parts(register, other)
        workspace.sabot.unite(register, other)
        workspace.remove(request.other)

    @call
    def Gather(self, workspace: Workspace, request: messages.GatherRequest) -> messages.Done:
        picks = requests.picks(workspace, request.picks)
        workspace.require_place(1)
        return messages.Done(registers=[workspace.add(workspace.sabot.gather(picks))])

    @call
    def Drop(self, workspace: Workspace, request: RegisterRequest) -> None:
        register = workspace.require(request.register)
        workspace.sabot.drop(register, requests.draws(request.draws, register))
        workspace.remove(request.register)

    @call
    def Dump(self, workspace: Workspace, request: messages.DumpRequest) -> DumpReply:
        if request.members > MAX_DUMPED_MEMBERS:
            raise invalid(f"members {request.members}; at most {MAX_DUMPED_MEMBERS} are dumped")
        if not 1 <= len(request.registers) <= MAX_DUMPED_REGISTERS:
            raise invalid(
                f"{len(request.registers)} registers; name 1 to {MAX_DUMPED_REGISTERS} of them"
            )
        registers = [workspace.require(number) for number in request.registers]
        if len({register.size for register in registers}) > 1:
            raise invalid("the registers have different sizes; dump those of one size together")
        return DumpReply(
            backend=workspace.sabot.simulated_by(*registers),
            states=dumped(workspace, registers, request.members),
        )


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
