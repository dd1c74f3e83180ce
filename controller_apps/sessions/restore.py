"""The start of a controller that comes after another: reads what that one has kept."""

from logging import Logger

from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.snapshot import decode_hosts, decode_session
from controller_apps.sessions.state_folder import StateFolder
from wire.malformed import MalformedPacket


def take_over(state: StateFolder, arbiter: Arbiter, logger: Logger, now: float) -> list[int]:
    """Give the arbiter the hosts and sessions that were kept; return the sessions.

    What cannot be read, or cannot be beside another session, is logged and dropped.
    """
    if state.restored:
        arbiter.recovery.begun = now
    try:
        for at, host_port in decode_hosts(state.hosts()).items():
            arbiter.network.attach(at, host_port)
    except MalformedPacket as error:
        logger.warning("hosts that were kept: %s", error)
    return [
        number
        for number, data in list(state.sessions())
        if _resume(number, data, state, arbiter, logger, now)
    ]


def _resume(
    number: int, data: bytes, state: StateFolder, arbiter: Arbiter, logger: Logger, now: float
) -> bool:
    try:
        session = decode_session(data, now)
        if session.number != number:
            raise MalformedPacket(f"it is session {session.number:016x}")
        arbiter.resume(session, now)
    except MalformedPacket as error:
        logger.warning("session %016x that was kept: %s", number, error)
        state.forget_session(number)
        return False
    return True
