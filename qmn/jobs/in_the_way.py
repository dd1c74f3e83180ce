"""Elements in the way of a run's light, as the controller records them; told while it lasts."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console

from topologies.networks.network import Network
from wire.controller_lines import NewFacts
from wire.metadata.vocabulary import Reason

BROKEN = (Reason.FIBER_CUT.name, Reason.PATH_BROKEN.name)


class InTheWay:
    """What was last in the way of light: for a refusal, or for a session that has none."""

    def __init__(self) -> None:
        self.found = ""
        self._stranded: str | None = None  # number of the session that has no light

    def hear(self, fact: Mapping[str, Any]) -> None:
        """Take the next fact of the controller's record."""
        event = fact["event"]
        why, _, elements = str(fact.get("detail", "")).partition(": ")
        if event == "stranded":
            self.found, self._stranded = why, fact["session"]
        elif event == "refused" and (why in BROKEN or self._stranded is None):
            self.found = elements if why in BROKEN else ""
        elif event == "granted" and fact["session"] == self._stranded:
            pass  # another request of it is granted, while its fibre is cut all the same
        elif event in ("granted", "moved") or (event == "port" and fact["up"]):
            self.found, self._stranded = "", None


def in_the_way(record: Iterable[Mapping[str, Any]]) -> str:
    """Return what was in the way of light at the end of a record; "" for nothing."""
    state = InTheWay()
    for fact in record:
        state.hear(fact)
    return state.found


class LostLight:
    """Says that a session has lost its light, as soon as the controller has found it.

    The session goes on if its light is back in time, so this is not an error yet.
    """

    def __init__(self, network: Network, console: Console) -> None:
        self._facts, self._console = NewFacts(network.runtime.logs), console
        self._state = InTheWay()

    def look(self) -> None:
        """Read what the controller has recorded since the last look; say what has changed."""
        for fact in self._facts.read():
            before = self._state.found
            self._state.hear(fact)
            now = self._state.found
            if now and now != before:
                self._console.print(f"no light: {now}", soft_wrap=True)
            elif before and not now and fact["event"] != "refused":
                self._console.print("light is back")

    def close(self) -> None:
        self._facts.close()


@contextmanager
def lost_light(network: Network, console: Console) -> Iterator[LostLight]:
    told = LostLight(network, console)
    try:
        yield told
    finally:
        told.close()
