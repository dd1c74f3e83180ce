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
"""

from collections import deque
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass

from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.framing import BLOCKS_UNDER_WAY
from hosts.middleware.services.superdense.options import sent_half
from hosts.middleware.services.superdense.per_pair import PerPair
from hosts.middleware.services.superdense.sender import Light, Sender, Singles
from hosts.middleware.session import protocol
from hosts.middleware.session.protocol import (
    Await,
    BeginEmit,
    Collect,
    Concurrently,
    Hear,
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
        where = port, setup.rate_hz, setup.wavelength_pm
        light = yield from begin(Qnic.modulate, half, paulis, *where, LIGHT_TIMEOUT_S)
        # The light may be on its way again before the source has answered.
        _left, sent_on = yield Await((source, light))
        if not sent_on:
            yield Collect(source)  # word of its light is not faster than that itself
        sent_ns: int | None = yield Collect(light, GRACE_S + paulis.size / setup.rate_hz)
        return sent_ns
