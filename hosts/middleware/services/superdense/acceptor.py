"""The protocol of the end of superdense coding that receives bytes; opener.py's mirror.

Its analyser waits for the light of the next block before there is word of it, as detectors do.
receiver.py makes symbols and reports of outcomes. No socket, no clock.
"""

import numpy as np

from hosts.hardware import pair_light
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Coincidences, HardwareError, Symbols
from hosts.middleware.services.superdense.options import arrival_ports
from hosts.middleware.services.superdense.receiver import (
    Collect,
    Discard,
    Measure,
    Receiver,
    answer_to,
    check_offer,
)
from hosts.middleware.session import protocol
from hosts.middleware.session.blocks import RESERVED
from hosts.middleware.session.errors import SessionError, unexpected
from hosts.middleware.session.protocol import (
    Await,
    Cancel,
    Connection,
    Deliver,
    HearNext,
    Light,
    OnConnection,
    Say,
    Side,
    Steps,
    WaitUntil,
    begin,
    do,
)
from hosts.timeouts import (
    ARRIVED_TIMEOUT_S,
    EXPECTED_TIMEOUT_S,
    OUTCOME_TIMEOUT_S,
    PAIR_TIMEOUT_S,
)
from wire.metadata.blocks import Block, Finish
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason

FIRST_BLOCK = 1


def accepted(symbols: int, setup: Setup) -> Answer:
    """Return the reply to a set-up, by the distinguishable Bell states; or SessionError."""
    check_offer(setup, symbols)
    return answer_to(setup, symbols, setup.rotation)


class Acceptor:
    """Has what a receiver orders done by this host's Bell analyser."""

    def __init__(self, side: Side, symbols: int) -> None:
        """Receive by an analyser that distinguishes `symbols` Bell states."""
        self._side = side
        self.receiver = Receiver(side.setup, symbols, side.peer)
        self._expected: tuple[int, Light] | None = None  # a block, and its light
        # Of single pairs, until their block arrives, by their numbers.
        self._read: dict[int, Symbols] = {}
        self._failed: dict[int, SessionError | HardwareError] = {}
        self._missing: set[int] = set()  # that the block needs, and are not over

    def run(self) -> Steps[None]:
        """Receive until the sender has finished; raise SessionError if it does not."""
        yield from self._expect(FIRST_BLOCK)
        while not isinstance(message := (yield HearNext()), Finish):
            if not isinstance(message, Block):
                raise unexpected(message, self._side.peer)
            symbols = yield from self._carry_out(self.receiver.block(message))
            yield from self._expect(message.block + 1)
            data, report = self.receiver.arrived(symbols)
            if data:
                yield Deliver(data)
            yield Say((report,))
        self.receiver.finish(message)

    def join(self, connection: Connection, setup: Setup, peer: str) -> Steps[None]:
        """Return what serves the handshake of a single pair; SessionError if it must not be.

        It accepts, waits for the end of the connection, and measures.
        """
        answer, order = self.receiver.join(setup, peer)
        return self._single(connection, answer, order)

    def _single(self, connection: Connection, answer: Answer, order: Measure) -> Steps[None]:
        try:
            yield OnConnection(connection, _until_closed(answer))
            self._read[order.block] = yield from self._measure(order)
        except (SessionError, HardwareError) as error:  # for who collects it
            self._failed[order.block] = error
        self._missing.discard(order.block)

    def _carry_out(self, order: Measure | Discard | Collect) -> Steps[Symbols]:
        match order:
            case Measure():
                return (yield from self._measure(order))
            case Collect():
                return (yield from self._collect(order.numbers))
            case Discard():
                light = yield from self._taken(order.block)
                if light is not None:
                    yield Cancel(light)
                yield from do(Qnic.discard_block, self._side.setup.session, order.block)
                return np.empty(0, dtype=np.uint8)

    def _expect(self, block: int) -> Steps[None]:
        """Begin to wait for the light of a block; single pairs have handshakes of their own."""
        if self._side.setup.handshake == Handshake.FRAMED and block < RESERVED:
            light = yield from self._detecting(block, EXPECTED_TIMEOUT_S, following=True)
            self._expected = block, light

    def _measure(self, order: Measure) -> Steps[Symbols]:
        coincidences = yield from self._found(order.block)
        if coincidences is None:
            yield from do(Qnic.discard_block, self._side.setup.session, order.block)
            return self.receiver.read(order, None)
        return self.receiver.read(order, coincidences.outcomes)

    def _found(self, block: int) -> Steps[Coincidences | None]:
        """Return the arrivals of a block that was sent; None: it is lost."""
        light = yield from self._taken(block)
        if light is None:
            detection = yield from self._detecting(block, ARRIVED_TIMEOUT_S)
            return (yield protocol.Collect(detection))  # type: ignore[no-any-return]
        (here,) = yield Await((light,), OUTCOME_TIMEOUT_S)
        if here and (coincidences := (yield protocol.Collect(light))) is not None:
            return coincidences  # type: ignore[no-any-return]
        # If light was here, its outcome comes before what is asked now is answered.
        detection = yield from self._detecting(block, ARRIVED_TIMEOUT_S)
        here, _answered = yield Await((light, detection))
        coincidences = (yield protocol.Collect(light)) if here else None
        if coincidences is None:
            coincidences = yield protocol.Collect(detection)
        for each in (light, detection):
            yield Cancel(each)
        return coincidences  # type: ignore[no-any-return]

    def _taken(self, block: int) -> Steps[Light | None]:
        """Return the light of a block if it is expected; nothing is any more then."""
        if self._expected is None:
            return None
        (number, light), self._expected = self._expected, None
        if number != block:
            yield Cancel(light)
            return None
        return light

    def _detecting(self, block: int, timeout_s: float, following: bool = False) -> Steps[Light]:
        side = self._side
        ports, session = arrival_ports(side.setup, side.ports), side.setup.session
        return begin(pair_light.detect_pairs, session, block, ports, timeout_s, following)

    def _collect(self, numbers: range) -> Steps[Symbols]:
        """Return the symbols of pairs when all are over; raise what one of them has failed with."""
        read, failed, missing = self._read, self._failed, self._missing
        missing.update(number for number in numbers if number not in read)
        missing.difference_update(failed)
        if not (yield WaitUntil(lambda: failed or not missing, PAIR_TIMEOUT_S)):
            raise SessionError(
                Reason.PROTOCOL,
                f"pairs up to {numbers[-1]} were not over in {PAIR_TIMEOUT_S:g} s",
            )
        for error in failed.values():
            raise error
        return np.concatenate([read.pop(number) for number in numbers])


def _until_closed(answer: Answer) -> Steps[None]:
    """Accept a pair; the sender closes the connection when its light has left."""
    yield Say((answer,))
    yield HearNext(timeout_s=PAIR_TIMEOUT_S)
