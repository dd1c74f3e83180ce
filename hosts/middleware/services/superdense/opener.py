"""The protocol of the end of superdense coding that sends bytes: no socket, no clock.

    alice                      charlie (source)             bob
      | Setup(SDC) -- held by the controller until the paths are up --> |
      | <--------------- Answer (symbols and operators that bob can use) |
      | Setup(PAIR_SOURCE) ------> |                                    |
      | Emission ----------------> | pairs: half 0 to alice, half 1 to bob
      | <-- light, half 0 -------- | -- light, half 1 ----------------> |
      | Pauli operators, then light, half 0 --------------------------> |
      | Block (what it carried) --------------------------------------> |
      | <------------------------------------------ Report (what came)  |

The source answers nothing. If light does not come, it is asked whether it is over (Emitted).

With the handshake per-pair every pair has a Setup(ONE_PAIR) connection of its own, and the
paths stay up only as long as that connection (paper, figure "handshaking").
sender.py decides on the load of blocks.

A handshake for every Bell state (paper, figure "handshaking"), the next ones made ahead or not.

    pair 1   |-- handshake --|-- light --| close
    pair 2        |-- handshake --|-- light --| close
    pair 3             |-- handshake --|-- light --| close

Connections are closed in order: the newest one keeps the light path up. In the sequential handshake
nothing is made ahead, as in the paper, and each pair has a light path of its own:

    pair 1   |-- handshake --|-- light --| close
    pair 2                                      |-- handshake --|-- light --| close

No socket, no clock.
"""

from collections import deque
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from operator import contains

from hosts.hardware import pair_light
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.hardware.steps import Pulses
from hosts.middleware.services.superdense.frame_format import BLOCKS_UNDER_WAY
from hosts.middleware.services.superdense.options import sent_half
from hosts.middleware.services.superdense.sender import Light, Sender, Singles
from hosts.middleware.session import protocol
from hosts.middleware.session.encoding import to_paulis
from hosts.middleware.session.protocol import (
    Await,
    BeginEmit,
    Collect,
    Concurrently,
    Hear,
    Join,
    Leave,
    Now,
    OpenerSide,
    Say,
    Steps,
    WaitUntil,
    begin,
    do,
)
from hosts.timeouts import GRACE_S, LIGHT_TIMEOUT_S, REPORT_TIMEOUT_S
from wire.metadata.blocks import Report
from wire.metadata.setup import Answer
from wire.results.figures import SenderFigures

HANDSHAKES_AHEAD = 3
LIGHTS_AT_A_TIME = 2

# Sends one pair on by this operator; when (ns) it left, None if there was no light.
SendOn = Callable[[int, Symbols], Steps[int | None]]


@dataclass
class PerPair:
    """Sends photons each under a handshake of its own."""

    sender: Sender
    send_on: SendOn
    sequential: bool = False  # a handshake begins when the pair before it is over
    # By number of the pair: an open connection, and by which operators symbols are sent then;
    _agreed: dict[int, tuple[object, int]] = field(default_factory=dict, init=False)
    _over: dict[int, int] = field(default_factory=dict, init=False)  # and when (ns) it was sent

    def send(self, order: Singles) -> Steps[int]:
        """Send pairs; one without light is just lost. Return when the first was sent (ns)."""
        first, count, begun = order.first, order.symbols.size, 0
        ahead, at_a_time = (1, 1) if self.sequential else (HANDSHAKES_AHEAD, LIGHTS_AT_A_TIME)
        self._over.clear()
        for index in range(count):
            while begun < min(index + ahead, count):
                yield Concurrently(self._shake_hands(first + begun))
                begun += 1
            number = first + index
            yield WaitUntil(partial(contains, self._agreed, number))
            yield Concurrently(
                self._pair(number, order.symbols[index : index + 1], number == first)
            )
            if index + 1 >= at_a_time:
                yield from self._until_over(number + 1 - at_a_time)
        yield from self._until_over(first + count - 1)
        return self._over[first]

    def _shake_hands(self, number: int) -> Steps[None]:
        """Make the handshake of a pair; the path stays up until its connection is closed."""
        connection, answer = yield Join(self.sender.single(number))
        self._agreed[number] = connection, self.sender.single_encoding(answer)

    def _pair(self, number: int, symbol: Symbols, is_first: bool) -> Steps[None]:
        connection, encoding = self._agreed.pop(number)
        sent_ns = yield from self.send_on(number, to_paulis(symbol, encoding))
        if not is_first:
            yield from self._until_over(number - 1)
        yield Leave(connection, seen=self.sequential)
        self._over[number] = sent_ns or 0

    def _until_over(self, number: int) -> Steps[None]:
        yield WaitUntil(partial(contains, self._over, number))


@dataclass(eq=False)
class Turn:
    """A block under way."""

    over: bool = False  # its light has left, or there was none, and the receiver knows


class Opener:
    """Has a sender's light made by a source, tells of it, and hears the other end's reports."""

    def __init__(
        self, side: OpenerSide, answer: Answer, source: str, now_s: float, sequential: bool = False
    ) -> None:
        """Raise SessionError if the receiver does not say what its analyser can do.

        Sequential: of handshakes of single pairs, each begins when the one before it is over.
        """
        self._side = side
        self._sender = Sender(side.setup, answer, side.other_host, now_s)
        self._per_pair = PerPair(self._sender, self._single, sequential)
        self._why_dark = f"no light from {source} at {side.ports[0]}"

    @property
    def sent(self) -> tuple[int, bytes]:
        """How many bytes the other end holds, and their SHA-256."""
        return self._sender.sent

    @property
    def summary(self) -> SenderFigures:
        return copy(self._sender.statistics)

    def counts(self) -> Mapping[str, int]:
        statistics = self._sender.statistics
        return {
            "pairs_sent": statistics.bell_pairs,
            "pairs_lost": statistics.lost_pairs,
            "symbol_errors": statistics.symbol_errors,
            "repeated_frames": statistics.repeated_frames,
        }

    def send(self, data: bytes) -> Steps[None]:
        """Send bytes; over when the other end holds every one of them."""
        self._sender.send(data)
        under_way: deque[Turn] = deque()
        while True:
            if (order := self._sender.next_order()) is not None:
                before = under_way[-1] if under_way else None
                under_way.append(Turn())
                yield Concurrently(self._carry_out(order, under_way[-1], before))
            elif under_way:
                yield WaitUntil(lambda: under_way[0].over)
                under_way.popleft()
                report = yield Hear(Report, REPORT_TIMEOUT_S)
                self._sender.heard(report, (yield Now()))
            else:
                return

    def _carry_out(self, order: Light | Singles, turn: Turn, before: Turn | None) -> Steps[None]:
        """Make light, and tell the receiver of it; blocks keep their order."""
        emitted_ns: int | None
        if isinstance(order, Singles):
            emitted_ns = yield from self._per_pair.send(order)
        else:
            emitted_ns = yield from self._block(order, before)
        if emitted_ns is None:
            yield Say((self._sender.dark(self._why_dark),))
        else:
            yield Say((self._sender.lit(emitted_ns),))
        turn.over = True

    def _block(self, order: Light, before: Turn | None) -> Steps[int | None]:
        """Have the source make a block meanwhile; send it on behind the one before it.

        Return when its light has left (ns), or None.
        """
        number, paulis = order.block, order.paulis
        source = yield BeginEmit(number, paulis.size, BLOCKS_UNDER_WAY)
        if before is not None:
            yield WaitUntil(lambda: before.over)
        if self._sender.is_called_off(number):
            yield Collect(source)
            yield from do(Qnic.discard_block, self._side.setup.session, number)
            return None
        return (yield from self._send_on(number, paulis, source))

    def _single(self, number: int, pauli: Symbols) -> Steps[int | None]:
        """Have one pair made, and send this host's half on; return when that left (ns), or None."""
        source = yield BeginEmit(number, pauli.size)
        sent_ns = yield from self._send_on(number, pauli, source)
        if sent_ns is not None:
            yield Collect(source)
        return sent_ns

    def _send_on(self, number: int, paulis: Symbols, source: protocol.Light) -> Steps[int | None]:
        """Modulate this host's halves of a block that is being made, and send them on."""
        side, setup = self._side, self._side.setup
        half, port = side.block(number, sent_half(setup)), side.ports[0]
        pulses = Pulses(setup.rate_hz, setup.wavelength_pm)
        light = yield from begin(pair_light.modulate, half, paulis, port, pulses, LIGHT_TIMEOUT_S)
        # The light may be on its way again before the source has answered.
        _left, sent_on = yield Await((source, light))
        if not sent_on:
            yield Collect(source)  # word of its light is not faster than that itself
        sent_ns: int | None = yield Collect(light, GRACE_S + paulis.size / setup.rate_hz)
        return sent_ns
