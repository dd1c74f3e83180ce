"""The holders of light: who gave back last what another session waits for. No socket, no clock."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from controller_apps.light.paths import Direction

Ends = tuple[str, str]  # addresses of a session's opener and acceptor


class Holder(NamedTuple):
    """A session that has given light back."""

    order: int  # the later, the larger
    session: int
    ends: Ends
    frequency_mhz: int


@dataclass
class Holders:
    """Who has given back each direction of a port last."""

    order: int = 0  # how often light was given back
    _last: dict[Direction, Holder] = field(default_factory=dict)

    def gave_back(
        self, ways: Iterable[Direction], session: int, ends: Ends, frequency_mhz: int
    ) -> None:
        self.order += 1
        holder = Holder(self.order, session, ends, frequency_mhz)
        self._last.update(dict.fromkeys(ways, holder))

    def last(
        self, ways: Iterable[Direction], session: int, frequency_mhz: int, since: int
    ) -> Holder | None:
        """Return which other session gave the last of these back after a moment, if one did.

        The opposite direction counts where its light had another frequency: a port has one tuning.
        """
        found: list[Holder] = []
        for way in ways:
            same, opposite = self._last.get(way), self._last.get(way.opposite)
            found += [same] if same is not None else []
            if opposite is not None and opposite.frequency_mhz != frequency_mhz:
                found.append(opposite)
        return max(
            (each for each in found if each.order > since and each.session != session),
            default=None,
        )
