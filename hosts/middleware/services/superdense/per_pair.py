"""A handshake for every Bell state (paper, figure "handshaking"), the next ones made ahead or not.

    pair 1   |-- handshake --|-- light --| close
    pair 2        |-- handshake --|-- light --| close
    pair 3             |-- handshake --|-- light --| close

Connections are closed in order: the newest one keeps the light path up. In the sequential handshake
nothing is made ahead, as in the paper, and each pair has a light path of its own:

    pair 1   |-- handshake --|-- light --| close
    pair 2                                      |-- handshake --|-- light --| close

No socket, no clock.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from operator import contains

from hosts.hardware.replies import Symbols
from hosts.middleware.services.superdense.sender import Sender, Singles
from hosts.middleware.session.encoding import to_paulis
from hosts.middleware.session.protocol import Concurrently, Join, Leave, Steps, WaitUntil

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
