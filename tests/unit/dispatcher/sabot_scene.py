"""Requests to a server of sabot, and those that are refused."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import grpc

from applications.sabot_server.sabot_servicer import serving
from dispatcher.sabot.limits import MAX_COUNT
from wire import sabot_pb2 as messages
from wire.dispatcher_pb2 import (
    CreateRequest,
)
from wire.sabot_pb2_grpc import SabotStub

Code = grpc.StatusCode
MAX_LIVE = 100_000
PREPARED = CreateRequest.PREPARED
PAIRS, ZEROS = messages.CreateRequest.BELL_PAIRS, messages.CreateRequest.ZEROS
DRAWS = messages.Draws(seed="1", session=7, purpose="test")


@contextmanager
def serving_in(folder: Path) -> Iterator[str]:
    """Run a server; return the path of its socket."""
    socket = str(folder / "s.sock")
    with serving(socket, MAX_LIVE):
        yield socket


@contextmanager
def stub_of(folder: Path) -> Iterator[Any]:
    """Run a server; return a stub."""
    with serving_in(folder) as socket, grpc.insecure_channel(f"unix:{socket}") as channel:
        yield SabotStub(channel)  # type: ignore[no-untyped-call]


def prepare(stub: Any) -> messages.Done:
    """Make registers 1 and 2 (a pair), 3 (of another size) and 4 in workspace 1."""
    stub.Begin(messages.BeginRequest(backend="chp"))
    for count, state in ((4, PAIRS), (5, ZEROS), (4, ZEROS)):
        stub.Create(messages.CreateRequest(workspace=1, count=count, state=state))
    return status(stub)


def status(stub: Any) -> messages.Done:
    """Return what the workspace holds."""
    done: messages.Done = stub.Apply(messages.ApplyRequest(workspace=1, register=4))
    return done


def gate(name: str, **fields: Any) -> messages.ApplyRequest:
    """Return the request of one gate on register 1."""
    gates = [messages.Gate(name=name, **fields)]
    return messages.ApplyRequest(workspace=1, register=1, gates=gates)


def draws(**fields: Any) -> messages.RegisterRequest:
    """Return the request to measure with these draws."""
    named = messages.Draws(**{"seed": "1", "purpose": "test", **fields})
    return messages.RegisterRequest(workspace=1, register=1, draws=named)


def measure(**fields: Any) -> messages.RegisterRequest:
    """Return the request to measure."""
    return messages.RegisterRequest(**{"workspace": 1, "register": 1, "draws": DRAWS, **fields})


def gather(*picks: tuple[int, list[int]]) -> messages.GatherRequest:
    """Return the request to gather qubits of registers."""
    every = [messages.GatherRequest.Pick(register=r, positions=at) for r, at in picks]
    return messages.GatherRequest(workspace=1, picks=every)


def bell(first: int, second: int) -> messages.RegisterRequest:
    """Return the request to Bell-measure."""
    return messages.RegisterRequest(
        workspace=1, register=first, other=second, draws=DRAWS, other_draws=DRAWS
    )


REFUSED = [
    ("Begin", messages.BeginRequest(backend="magic"), Code.INVALID_ARGUMENT, "chp, dense, stim"),
    ("End", messages.RegisterRequest(workspace=9), Code.NOT_FOUND, "no workspace 9"),
    ("Create", messages.CreateRequest(workspace=9, count=1), Code.NOT_FOUND, "no workspace 9"),
    ("Create", messages.CreateRequest(workspace=1), Code.INVALID_ARGUMENT, "count 0"),
    (
        "Create",
        messages.CreateRequest(workspace=1, count=MAX_COUNT + 1),
        Code.INVALID_ARGUMENT,
        "count 4000001",
    ),
    (
        "Create",
        messages.CreateRequest(workspace=1, count=MAX_LIVE),
        Code.RESOURCE_EXHAUSTED,
        "limit of 100000",
    ),
    (
        "Create",
        messages.CreateRequest.FromString(b"\x08\x01\x10\x01\x18\x07"),
        Code.INVALID_ARGUMENT,
        "state 7",
    ),
    (
        "Apply",
        messages.ApplyRequest(workspace=1, register=99),
        Code.NOT_FOUND,
        "no register 99",
    ),
    (
        "Apply",
        messages.ApplyRequest(workspace=1, register=1, paulis=b"\x00\x01"),
        Code.INVALID_ARGUMENT,
        "2 bytes for 4 photons",
    ),
    (
        "Apply",
        messages.ApplyRequest(workspace=1, register=1, paulis=b"\x00\x01\x02\x04"),
        Code.INVALID_ARGUMENT,
        "paulis[3] is 4",
    ),
    ("Apply", gate("SWAP"), Code.INVALID_ARGUMENT, "'SWAP' is unknown"),
    ("Apply", gate("CX"), Code.NOT_FOUND, "no register 0"),
    ("Apply", gate("CX", target=1), Code.INVALID_ARGUMENT, "named twice"),
    ("Apply", gate("CX", target=3), Code.INVALID_ARGUMENT, "must pair up"),
    ("Apply", gate("RX", angle_rad=float("nan")), Code.INVALID_ARGUMENT, "not finite"),
    (
        "Apply",
        gate("RX", angles_rad=[0, 0, 0, float("inf")]),
        Code.INVALID_ARGUMENT,
        "inf of RX is not finite",
    ),
    ("Apply", gate("RX", angles_rad=[0]), Code.INVALID_ARGUMENT, "1 angles of RX for 4 qubits"),
    (
        "Apply",
        messages.ApplyRequest(workspace=1, register=1, gates=[messages.Gate(name="H")] * 257),
        Code.INVALID_ARGUMENT,
        "257 gates",
    ),
    ("Measure", measure(register=99), Code.NOT_FOUND, "no register 99"),
    ("Measure", measure(bases=b"\x00"), Code.INVALID_ARGUMENT, "1 bytes for 4 photons"),
    ("Measure", measure(bases=b"\x00\x05\x00\x00"), Code.INVALID_ARGUMENT, "bases[1] is 5"),
    ("Measure", draws(seed=""), Code.INVALID_ARGUMENT, "seed ''"),
    ("Measure", draws(seed="9" * 101), Code.INVALID_ARGUMENT, "not a whole number"),
    ("Measure", draws(purpose="x" * 201), Code.INVALID_ARGUMENT, "201 letters"),
    ("BellMeasure", bell(1, 1), Code.INVALID_ARGUMENT, "named twice"),
    ("BellMeasure", bell(1, 3), Code.INVALID_ARGUMENT, "must pair up"),
    (
        "Reset",
        messages.RegisterRequest(workspace=1, register=1, mask=b"", draws=DRAWS),
        Code.INVALID_ARGUMENT,
        "0 bytes for 4 qubits",
    ),
    (
        "Lose",
        messages.RegisterRequest(workspace=1, register=1, mask=b"\x1f"),
        Code.INVALID_ARGUMENT,
        "behind its last qubit",
    ),
    (
        "Part",
        messages.RegisterRequest(workspace=1, register=1, mask=b"\x01\x00"),
        Code.INVALID_ARGUMENT,
        "2 bytes for 4 qubits",
    ),
    (
        "Unite",
        messages.RegisterRequest(workspace=1, register=1, other=2),
        Code.INVALID_ARGUMENT,
        "not two parts",
    ),
    (
        "Unite",
        messages.RegisterRequest(workspace=1, register=1, other=1),
        Code.INVALID_ARGUMENT,
        "named twice",
    ),
    ("Gather", gather(), Code.INVALID_ARGUMENT, "count 0"),
    ("Gather", gather((1, [0]), (99, [0])), Code.NOT_FOUND, "no register 99"),
    ("Gather", gather((1, [0]), (2, [4])), Code.INVALID_ARGUMENT, "positions[0] is 4"),
    ("Gather", gather((1, [0]), (1, [1])), Code.INVALID_ARGUMENT, "register 1 is picked twice"),
    ("Gather", gather((1, [1, 2, 1])), Code.INVALID_ARGUMENT, "name 1 twice"),
    ("Drop", messages.RegisterRequest(workspace=1, register=1), Code.INVALID_ARGUMENT, "seed ''"),
    (
        "Dump",
        messages.DumpRequest(workspace=1, registers=[1], members=65),
        Code.INVALID_ARGUMENT,
        "at most 64",
    ),
    ("Dump", messages.DumpRequest(workspace=1), Code.INVALID_ARGUMENT, "0 registers"),
    (
        "Dump",
        messages.DumpRequest(workspace=1, registers=[1, 3]),
        Code.INVALID_ARGUMENT,
        "different sizes",
    ),
]
