"""Where the page of a live view is: on the loopback, or in a container, which leads there."""

import os
from dataclasses import dataclass
from pathlib import Path

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Place:
    """A port of the loopback, 0 for one that is free; with a socket, the port that leads to it."""

    port: int = 0
    socket: Path | None = None


def place_of_container() -> Place | None:
    """Return where docker/run wants the page to be served; None outside of a container of its."""
    socket, port = os.environ.get("QMN_LIVE_SOCKET"), os.environ.get("QMN_LIVE_PORT")
    return Place(int(port), Path(socket)) if socket and port else None
