"""The commands of other people's programs that make a tunnel, and what every tunnel can do."""

import subprocess
import time
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar
from uuid import UUID

from applications.timeouts import COMMAND_TIMEOUT_S, TUNNEL_POLL_S, TUNNEL_TIMEOUT_S

Answer = TypeVar("Answer")


class Tunnel(Protocol):
    """One end of a tunnel whose key can be changed."""

    def set_up(self) -> None:
        """Make it, closed; TunnelError if it cannot be."""

    def use(self, key_id: UUID, key: bytes) -> None:
        """Let packets pass with this key, as soon as both ends have it.

        With the key before they may pass until then, or until `end_former`; with no other.
        """

    def end_former(self) -> None:
        """Let packets pass with the key in use only."""

    def close(self) -> None:
        """Let no packet pass."""

    def handshake_done(self) -> bool:
        """Return whether both ends have shown that they have the key; one of them has to ask."""


class TunnelError(Exception):
    """A command of the tunnel has failed; the text has its words."""


def command(words: Sequence[str], data: bytes = b"") -> str:
    """Run a command; return what it says, or raise TunnelError."""
    try:
        done = subprocess.run(
            words, input=data, capture_output=True, check=False, timeout=COMMAND_TIMEOUT_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise TunnelError(f"{' '.join(words)}: {error}") from error
    if done.returncode:
        raise TunnelError(f"{' '.join(words)}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout.decode(errors="replace")


def wait_until_it_works(attempt: Callable[[], Answer]) -> Answer:
    """Return what an attempt does as soon as its program is ready; or raise its TunnelError."""
    deadline = time.monotonic() + TUNNEL_TIMEOUT_S
    while True:
        try:
            return attempt()
        except TunnelError:
            if time.monotonic() > deadline:
                raise
            time.sleep(TUNNEL_POLL_S)
