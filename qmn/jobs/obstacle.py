"""The obstacle that a run's light has met, by the controller's record; printed meanwhile."""

from collections.abc import Iterable, Mapping
from contextlib import closing
from typing import Any

from rich.console import Console

from topologies.networks.network import Network
from wire.controller_lines import NewFacts
from wire.metadata.vocabulary import Reason

BROKEN = (Reason.FIBER_CUT.name, Reason.PATH_BROKEN.name)


class Obstacle:
    """The last obstacle: of a refusal, or of a session without light."""

    def __init__(self) -> None:
        self.name = ""
        self._stranded: str | None = None  # number of the session that has no light

    def hear(self, fact: Mapping[str, Any]) -> None:
        event = fact["event"]
        why, _, elements = str(fact.get("detail", "")).partition(": ")
        if event == "stranded":
            self.name, self._stranded = why, fact["session"]
        elif event == "refused" and (why in BROKEN or self._stranded is None):
            self.name = elements if why in BROKEN else ""
        elif event == "granted" and fact["session"] == self._stranded:
            pass  # another request of it is granted, while its fibre is cut all the same
        elif event in ("granted", "moved") or (event == "port" and fact["up"]):
            self.name, self._stranded = "", None


def obstacle(record: Iterable[Mapping[str, Any]]) -> str:
    last = Obstacle()
    for fact in record:
        last.hear(fact)
    return last.name


class LostLight:
    """Prints that a session has lost its light, as soon as the controller has found it.

    The session goes on if its light is back in time, so this is not an error yet.
    """

    def __init__(self, network: Network, console: Console) -> None:
        self._facts, self._console = NewFacts(network.runtime.logs), console
        self._obstacle = Obstacle()

    def look(self) -> None:
        """Read what the controller has recorded since the last look; print what has changed."""
        for fact in self._facts.read():
            before = self._obstacle.name
            self._obstacle.hear(fact)
            now = self._obstacle.name
            if now and now != before:
                self._console.print(f"no light: {now}", soft_wrap=True)
            elif before and not now and fact["event"] != "refused":
                self._console.print("light is back")

    def close(self) -> None:
        self._facts.close()


def lost_light(network: Network, console: Console) -> "closing[LostLight]":
    return closing(LostLight(network, console))
