"""Requests to the dispatcher with spoiled fields, in the names of hosts who hold other qubits.

A host may do what it likes with its own: whatever it asks, what the others hold stays where and
what it was; and what is refused changes nothing at all.
"""

import asyncio
from random import Random
from typing import Any

from spoiling import spoil_fields

from dispatcher.refusal import Refusal
from dispatcher.sabot.dense import TooLarge
from evidence.laboratory import RATE_HZ, Laboratory
from wire import dispatcher_pb2 as messages
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.positions import pack

PHOTONS = 4
SHORT_S = 1e-9
MOST_LIVE = 50_000  # qubits, beyond which a new scene begins


def _fiber(host: str, number: int, port: int) -> Fiber:
    ends = FiberEnd(host, f"{host}-q{number}"), FiberEnd("q1", str(port))
    return Fiber(*ends, length_km=0.01)


CONFIG = DispatcherConfig(
    listen="",
    socket="",
    seed=1,
    tokens={},
    fibers=[_fiber("alice", 0, 1), _fiber("bob", 0, 2), _fiber("charlie", 0, 3)],
    switches=[QuantumSwitch("q1")],
)
HOSTS = "alice", "bob", "charlie"


def block(number: int, half: int = 0) -> messages.BlockId:
    """Return the name of a block of the one session."""
    return messages.BlockId(session=1, number=number, half=half)


def requests(host: int) -> list[tuple[str, Any]]:
    """Return requests that are right, or would be with another state; block numbers by host."""
    mine, other = block(host), block((host + 1) % 3)
    create = messages.CreateRequest(session=1, number=host + 10, count=PHOTONS)
    gate = messages.Gate(name=messages.Gate.CX, target=block(host, 1))
    launch = messages.Launch(block=mine, port=f"{HOSTS[host]}-q0")
    pick = messages.Pick(block=mine, photons=pack([0, 2]))
    return [
        ("create", create),
        ("apply", messages.ApplyRequest(block=mine, paulis=b"\0\1\2\3", gates=[gate])),
        ("send", messages.SendRequest(launches=[launch], rate_hz=RATE_HZ)),
        (
            "receive",
            messages.ReceiveRequest(block=other, port=f"{HOSTS[host]}-q0", timeout_s=SHORT_S),
        ),
        ("measure", messages.MeasureRequest(block=mine, bases=b"\0\1\2\0")),
        ("bell_measure", messages.BellMeasureRequest(first=mine, second=block(host, 1))),
        ("store", messages.StoreRequest(block=mine)),
        ("discard", messages.DiscardRequest(block=other)),
        ("gather", messages.GatherRequest(into=block(host + 20), picks=[pick])),
        ("resend", messages.ResendRequest(block=mine, bases=b"\0\1\xff\2")),
        ("tell", messages.TellRequest(text="set Q0 0; init Q0")),
        ("sense", messages.SenseRequest(block=mine)),
        ("compensate", messages.CompensateRequest(every_s=SHORT_S)),
        ("split", messages.SplitRequest(block=mine, into=block(host + 30))),
    ]


class Dispatcher:
    """The physical layer of a small network, and hosts who ask it for nonsense."""

    def __init__(self, random: Random) -> None:
        self._random = random

    def feed(self, inputs: int) -> tuple[int, str]:
        """Make a number of requests; return how many were done, and the first fault in words."""
        return asyncio.run(self._feed(inputs))

    async def _feed(self, inputs: int) -> tuple[int, str]:
        done, scene = 0, await self._scene()
        for _ in range(inputs):
            if self._random.random() < 0.05 or scene.layer.sabot.live_qubits > MOST_LIVE:
                scene = await self._scene()
            host = self._random.randrange(3)
            kind, request = self._random.choice(requests(host))
            for _fault in range(self._random.choice((0, 1, 1, 2))):
                spoil_fields(request, self._random)
            if kind == "receive" and request.timeout_s > 0:
                request.timeout_s = SHORT_S  # nothing is to be waited for
            try:
                done += await self._ask(scene, HOSTS[host], kind, request)
            except Exception as error:  # noqa: BLE001 (this is what is looked for)
                words = f"{type(error).__name__}: {error}; {HOSTS[host]} asks to {kind}"
                return done, f"{words}: {request.SerializeToString().hex()}"
        return done, ""

    async def _scene(self) -> Laboratory:
        """Give every host pairs of its own, and a way for its light to the next."""
        laboratory = Laboratory(CONFIG)
        await laboratory.connect("q1", {1: 2, 2: 3, 3: 1})
        for number, name in enumerate(HOSTS):
            await laboratory.host(name).create(PHOTONS, number)
        return laboratory

    async def _ask(self, scene: Laboratory, host: str, kind: str, request: Any) -> bool:
        """Make one request, and look at what is left as it was; return whether it was done."""
        everything = [held(scene, name) for name in HOSTS]
        others = [held(scene, name) for name in HOSTS if name != host]
        live = scene.layer.sabot.live_qubits
        try:
            await scene.act(host, kind, request)
        except (Refusal, TooLarge):
            assert [held(scene, name) for name in HOSTS] == everything, "a refusal has changed who"
            assert scene.layer.sabot.live_qubits == live, "a refusal has changed how many qubits"
            return False
        left = [held(scene, name) for name in HOSTS if name != host]
        for before, after in zip(others, left, strict=True):
            assert before.items() <= after.items(), f"{host} has changed what another holds"
        return True


def held(scene: Laboratory, node: str) -> dict[Any, str]:
    """Return what a node holds: the place of each block, and which of its photons are there."""
    return {
        (each.name, each.port): each.register.present.tobytes().hex()
        for each in scene.layer.ownership.at_node(node)
    }
