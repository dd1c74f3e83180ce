"""The cost of a pair for the dispatcher while many others are alive."""

import time
from collections.abc import Iterator
from itertools import count

import grpc

from qmn.timeouts import CALL_TIMEOUT_S
from topologies.system.runs.runtime import Runtime
from wire.dispatcher_pb2 import (
    BellMeasureRequest,
    BlockId,
    CreateRequest,
    DiscardRequest,
    Order,
    StatusRequest,
    Step,
)
from wire.dispatcher_pb2_grpc import DispatcherStub
from wire.dispatcher_service import RUNNER, metadata

SESSION = 1
BLOCK_PAIRS = 1000
ROUNDS = 100


def cost_by_live_pairs(runtime: Runtime, amounts: list[int]) -> Iterator[tuple[int, float, float]]:
    """Yield (live pairs, seconds for a pair made and measured, bytes of state for a live pair).

    The amounts ascend. Everything goes over the dispatcher's own socket.
    """
    with grpc.insecure_channel(f"unix:{runtime.socket('dispatcher')}") as channel:
        load = _Load(channel, runtime.token("alice"), runtime.token(RUNNER))
        for amount in amounts:
            load.fill(amount)
            yield amount, load.seconds_for_a_pair(), load.bytes_for_a_pair()
        load.clear()


class _Load:
    """One host that keeps pairs alive and makes and measures others beside them."""

    def __init__(self, channel: grpc.Channel, token: str, runner: str) -> None:
        self._stub = DispatcherStub(channel)  # type: ignore[no-untyped-call]
        self._host = {"metadata": metadata(token), "timeout": CALL_TIMEOUT_S}
        self._runner = {"metadata": metadata(runner), "timeout": CALL_TIMEOUT_S}
        self._numbers = count()
        self._live = 0

    def fill(self, amount: int) -> None:
        """Make pairs until `count` are alive."""
        while self._live < amount:
            pairs = min(BLOCK_PAIRS, amount - self._live)
            self._perform(self._create(pairs))
            self._live += pairs

    def seconds_for_a_pair(self) -> float:
        """Return the mean time to make and measure one pair, in blocks."""
        started = time.perf_counter()
        for _ in range(ROUNDS):
            create = self._create(BLOCK_PAIRS)
            halves = [
                BlockId(session=SESSION, number=create.create.number, half=half) for half in (0, 1)
            ]
            measure = BellMeasureRequest(first=halves[0], second=halves[1])
            self._perform(create, Step(bell_measure=measure))
        return (time.perf_counter() - started) / (ROUNDS * BLOCK_PAIRS)

    def bytes_for_a_pair(self) -> float:
        return float(self._stub.Status(StatusRequest(), **self._runner).live_bytes) / self._live

    def clear(self) -> None:
        self._perform(Step(discard=DiscardRequest(session=SESSION)))

    def _create(self, pairs: int) -> Step:
        number = next(self._numbers)
        return Step(create=CreateRequest(session=SESSION, number=number, count=pairs))

    def _perform(self, *steps: Step) -> None:
        (outcome,) = self._stub.Perform(iter([Order(steps=steps)]), **self._host)
        if outcome.code:
            raise RuntimeError(f"the dispatcher refuses: {outcome.text}")
