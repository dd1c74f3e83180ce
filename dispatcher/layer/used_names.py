"""How often the name of a block has been used: random numbers are keyed by name.

A block that is created under a name that was used before, and is free again, must not draw what
the other one has drawn. Numbers of a session mostly follow one another: they are kept as ranges.
"""

from bisect import bisect_right

MOST_SESSIONS = 65_536  # remembered; their numbers are drawn at random, and never come again
MOST_RANGES = 4_096  # of a session; beyond, all up to the largest count as used
MOST_REPEATED = 65_536  # numbers of a session whose uses are counted


class UsedNumbers:
    """The block numbers of a session."""

    def __init__(self) -> None:
        """Begin with none."""
        self._begins: list[int] = []
        self._ends: list[int] = []  # of ranges; the last number and one more
        self._repeated: dict[int, int] = {}
        self._round = 0  # how often these were forgotten

    def use(self, number: int) -> str:
        """Note one more use of a number; return what tells it from earlier ones, first empty."""
        at = bisect_right(self._begins, number) - 1
        if at < 0 or number >= self._ends[at]:
            self._add(number, at)
            return ""
        if len(self._repeated) == MOST_REPEATED and number not in self._repeated:
            self._repeated.clear()
            self._round += 1
        self._repeated[number] = self._repeated.get(number, 0) + 1
        return f"again {self._round} {self._repeated[number]}"

    def _add(self, number: int, at: int) -> None:
        begins, ends = self._begins, self._ends
        if at >= 0 and ends[at] == number:
            ends[at] += 1
        else:
            at += 1
            begins.insert(at, number)
            ends.insert(at, number + 1)
        if at + 1 < len(begins) and begins[at + 1] == ends[at]:
            ends[at] = ends.pop(at + 1)
            del begins[at + 1]
        if len(begins) > MOST_RANGES:
            begins[:], ends[:] = [0], [ends[-1]]


class UsedNames:
    """The numbers of all sessions."""

    def __init__(self) -> None:
        """Begin with none."""
        self._sessions: dict[int, UsedNumbers] = {}

    def use(self, session: int, number: int) -> str:
        """Note that blocks of this name are created; return what tells them from earlier ones."""
        if session not in self._sessions:
            if len(self._sessions) == MOST_SESSIONS:
                del self._sessions[next(iter(self._sessions))]
            self._sessions[session] = UsedNumbers()
        return self._sessions[session].use(number)
