"""How many keys an application may still have: a bucket that fills at a rate."""

from collections.abc import Callable

from hosts.key_delivery.refusals import unavailable


class Allowance:
    """Counts stored keys against a rate, for each application on its own."""

    def __init__(self, keys_per_s: float, burst: int, now_s: Callable[[], float]) -> None:
        """Allow `burst` keys at once and `keys_per_s` in the long run; 0: as many as there are."""
        self._rate, self._burst, self._now_s = keys_per_s, burst, now_s
        self._left: dict[str, tuple[float, float]] = {}  # keys, and when

    def take(self, caller: str, count: int) -> None:
        """Count keys; raise Refused if they are too many just now."""
        if self._rate <= 0:
            return
        now = self._now_s()
        left, since = self._left.get(caller, (float(self._burst), now))
        left = min(float(self._burst), left + (now - since) * self._rate)
        if count > left:
            raise unavailable(
                f"{caller} has asked for more than {self._rate:g} keys a second: ask again in "
                f"{(min(count, self._burst) - left) / self._rate:.3g} s"
            )
        self._left[caller] = left - count, now
