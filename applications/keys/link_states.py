"""The states of a host's key links, as the controller hears them: stored keys, rate, QBER."""

import asyncio
from collections import deque
from collections.abc import Callable

from applications.keys.config import KeyManagerConfig
from applications.keys.delivery import KeyDelivery
from applications.keys.route_messages import UNKNOWN, LinkState
from applications.keys.sessions import Outcome
from applications.qkd.key_store import KEY_BITS

RATE_WINDOW_S = 60.0  # over which the rate of secret key is measured
PPM = 1_000_000


class Rate:
    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s, self._began_s = now_s, now_s()
        self._made: deque[tuple[float, int]] = deque()

    def add(self, bits: int) -> None:
        self._made.append((self._now_s(), bits))

    @property
    def bps(self) -> int:
        """Bits a second, over the last minute or since the beginning."""
        now = self._now_s()
        while self._made and self._made[0][0] < now - RATE_WINDOW_S:
            self._made.popleft()
        span_s = min(RATE_WINDOW_S, max(now - self._began_s, 1.0))
        return round(sum(bits for _at, bits in self._made) / span_s)


class KeyLinkStates:
    """The links of one host, as its sessions and stores show them."""

    def __init__(self, config: KeyManagerConfig, delivery: KeyDelivery) -> None:
        self._addresses, self._delivery = config.hosts, delivery
        clock = asyncio.get_running_loop().time  # another thread reads it, too
        self._rates = {link.peer: Rate(clock) for link in config.links}
        self._qbers: dict[str, float] = {}

    def ended(self, peer: str, outcome: Outcome) -> None:
        self._rates[peer].add(outcome.keys * KEY_BITS)
        if outcome.qber is not None:
            self._qbers[peer] = outcome.qber

    def all(self) -> tuple[LinkState, ...]:
        """Return the state of every link; it counts files."""
        return tuple(self._state(peer) for peer in self._rates)

    def _state(self, peer: str) -> LinkState:
        store = self._delivery.stores[peer]
        qber = self._qbers.get(peer)
        return LinkState(
            self._addresses[peer],
            store.mine,
            store.theirs,
            store.capacity,
            self._rates[peer].bps,
            UNKNOWN if qber is None else round(qber * PPM),
            peer in self._delivery.withheld,
        )
