"""Requests to a Sabot server with spoiled fields, beside a workspace of somebody else.

A refused request changes no workspace; one that is done changes its own alone.
"""

from random import Random
from typing import Any, NoReturn

from spoiling import spoil_fields

from applications.sabot_server.sabot_servicer import SabotService
from dispatcher.sabot.backends import BACKENDS
from wire import sabot_pb2 as messages

QUBITS = 4
MOST_LIVE = 2_000
MOST_REGISTERS = 24  # of which the states are looked at
MINE, OTHER = 6, 7  # workspaces, by numbers that no fault puts in


class Refused(Exception):
    """The server has refused."""


class Context:
    """A call's context, of which the service only asks for its end."""

    def abort(self, _code: object, text: str) -> NoReturn:
        """End the call."""
        raise Refused(text)


def requests(register: int) -> list[tuple[str, Any]]:
    """Return requests that are right, or would be with another state."""
    own: dict[str, Any] = {"workspace": MINE, "register": register}
    draws = messages.Draws(seed="1", session=7, purpose="fuzz")
    gate = messages.Gate(name="CX", target=register + 1)
    turn = messages.Gate(name="RX", angle_rad=0.5)
    pick = messages.GatherRequest.Pick(register=register, positions=[0, 2])
    pairs = messages.CreateRequest.BELL_PAIRS
    kraus: dict[str, Any] = {"operators": 1, "real": [1, 0, 0, 1], "imaginary": [0] * 4}
    both: dict[str, Any] = {"other": register + 1, "draws": draws, "other_draws": draws}
    return [
        ("Begin", messages.BeginRequest(backend="chp")),
        ("Create", messages.CreateRequest(workspace=MINE, count=QUBITS, state=pairs)),
        ("Apply", messages.ApplyRequest(**own, paulis=b"\0\1\2\3", gates=[gate, turn])),
        ("Measure", messages.RegisterRequest(**own, bases=b"\0\1\2\3", draws=draws)),
        ("BellMeasure", messages.RegisterRequest(**own, **both)),
        ("Reset", messages.RegisterRequest(**own, mask=b"\x05", draws=draws)),
        ("Kraus", messages.KrausRequest(**own, mask=b"\x05", draws=draws, **kraus)),
        ("Lose", messages.RegisterRequest(**own, mask=b"\x02")),
        ("Part", messages.RegisterRequest(**own, mask=b"\x03")),
        ("Unite", messages.RegisterRequest(**own, other=register + 1)),
        ("Gather", messages.GatherRequest(workspace=MINE, picks=[pick])),
        ("Drop", messages.RegisterRequest(**own, draws=draws)),
        ("Dump", messages.DumpRequest(workspace=MINE, registers=[register], members=QUBITS)),
    ]


class SabotServer:
    """A server with two workspaces, one of which is asked for nonsense."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._begin()

    def _begin(self) -> None:
        self._service, context = SabotService(MOST_LIVE), Context()
        backend = self._random.choice(sorted(BACKENDS))
        for number in range(1, OTHER + 1):
            self._service.Begin(messages.BeginRequest(backend=backend), context)
            if number < MINE:
                self._service.End(messages.RegisterRequest(workspace=number), context)
        for workspace in (MINE, OTHER):
            pairs = messages.CreateRequest.BELL_PAIRS
            for state in (pairs, messages.CreateRequest.ZEROS):
                made = messages.CreateRequest(workspace=workspace, count=QUBITS, state=state)
                self._service.Create(made, context)

    def feed(self, inputs: int) -> tuple[int, str]:
        """Make a number of requests; return how many were done, and the first fault in words."""
        done = 0
        for _ in range(inputs):
            if self._random.random() < 0.1:
                self._begin()
            kind, request = self._random.choice(requests(self._random.randrange(1, 6)))
            for _fault in range(self._random.choice((0, 1, 1, 2))):
                spoil_fields(request, self._random)
            try:
                done += self._ask(kind, request)
            except Exception as error:  # noqa: BLE001 (this is what is looked for)
                words = f"{type(error).__name__}: {error}; {kind}"
                return done, f"{words}: {request.SerializeToString().hex()}"
        return done, ""

    def _ask(self, kind: str, request: Any) -> bool:
        """Make one request, and look at what is left as it was; return whether it was done."""
        mine, other = self._held(MINE), self._held(OTHER)
        try:
            getattr(self._service, kind)(request, Context())
        except Refused:
            assert self._held(MINE) == mine, "a refusal has changed a state"
            return False
        finally:
            assert self._held(OTHER) == other, "another workspace has changed"
        return True

    def _held(self, workspace: int) -> list[bytes]:
        """Return the states of all registers that there are, and how much is live."""
        held = []
        for number in range(1, MOST_REGISTERS):
            asked = messages.DumpRequest(workspace=workspace, registers=[number], members=QUBITS)
            try:
                held.append(self._service.Dump(asked, Context()).SerializeToString())
            except Refused as refusal:
                held.append(str(refusal).encode())
        return held
