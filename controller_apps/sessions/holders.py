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
    order: int = 0  # how often light was given back
    _last: dict[Direction, Holder] = field(default_factory=dict)

    def gave_back(
        self, path: Iterable[Direction], session: int, ends: Ends, frequency_mhz: int
    ) -> None:
        self.order += 1
        holder = Holder(self.order, session, ends, frequency_mhz)
        self._last.update(dict.fromkeys(path, holder))

    def last(
        self, path: Iterable[Direction], session: int, frequency_mhz: int, since: int
    ) -> Holder | None:
        """Return which other session gave the last of these back after a moment, if one did.

        The opposite direction counts where its light had another frequency: a port has one tuning.
        """
        holders: list[Holder] = []
        for direction in path:
            same, opposite = self._last.get(direction), self._last.get(direction.opposite)
            holders += [same] if same is not None else []
            if opposite is not None and opposite.frequency_mhz != frequency_mhz:
                holders.append(opposite)
        return max(
            (holder for holder in holders if holder.order > since and holder.session != session),
            default=None,
        )
