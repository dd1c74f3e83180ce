"""The connection that speaks for a switch: the first of its datapath id, for as long as it lasts.

Whoever comes later with the same id is sent away, and does not displace it. A connection by the
controller's own loopback has to be of a process of root's or of its own user: bridges and agents
are, and no other local user can be a switch, not even before the real one is here.
"""

import logging
import os
from collections.abc import Callable
from ipaddress import IPv4Address
from typing import Any

from programs import local_users

ROOT = 0

log = logging.getLogger("speakers")


class Speakers:
    """The connections that speak for switches, by datapath id."""

    def __init__(self, dead: str, owner_of: Callable[[Any], int | None]) -> None:
        """`dead` is the state of a connection that has ended; owner_of gives its other end's user.

        None: it is of another machine.
        """
        self._dead, self._owner_of = dead, owner_of
        self._of: dict[int, Any] = {}

    def admits(self, datapath: Any, dpid: int) -> bool:
        """Tell whether a connection speaks for a switch; end one that does not."""
        speaker = self._of.get(dpid)
        if speaker is datapath:
            return True
        if datapath.state == self._dead:
            return False
        if speaker is not None and speaker.state != self._dead:
            self._send_away(datapath, dpid, "which is connected already")
            return False
        owner = self._owner_of(datapath)
        if owner not in (None, ROOT, os.geteuid()):
            self._send_away(datapath, dpid, f"as a process of user {owner}")
            return False
        self._of[dpid] = datapath
        return True

    def _send_away(self, datapath: Any, dpid: int, cause: str) -> None:
        log.warning("%s poses as switch %#x, %s: sent away", datapath.address, dpid, cause)
        datapath.close()


def owner(datapath: Any) -> int | None:
    """Return the user of the process at the other end of a connection, None if it is not here."""
    host, port = datapath.address[:2]
    if not IPv4Address(host).is_loopback:
        return None
    return local_users.owner(host, port)
