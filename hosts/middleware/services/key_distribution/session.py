"""The session of any key distribution: from blocks of light to keys in both stores.

    opener (alice of hosts.middleware.qkd)                     acceptor (bob)
      | Envelope(OPENER), Envelope(KEYS: Proposal) -------------> |  a key begins
      | Values(COMING) -----------------------------------------> |  gets ready to measure
      | <-------------------------------------------- Answer(OK)  |  one block ahead
      |   light, as the protocol makes it                         |
      | Values(OVER) -------------------------------------------> |
      | <----------------------------- Envelope(KEYS: Detections) |
      | Envelope(KEYS: Sifted) ---------------------------------> |  while the next block comes
      |   ... blocks, then error correction by envelopes ...      |
      |   ... and beside it Proposal, COMING, light of the next   |
      | Values(KEPT): the opener holds a key in its store ------> |
      | Finish: it holds all ----------------------------------> |

Blocks are for the key that was proposed last. The acceptor stores a key before it confirms it, and
withdraws it if the session ends before the opener has kept it, too.
"""

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from uuid import UUID

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.authentication import KeyPool
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.key_store import KeyStoreError
from hosts.middleware.qkd.keyring import NothingShared
from hosts.middleware.services.key_distribution.summary import Progress, summary
from hosts.middleware.services.key_distribution.under_way import NUMBERS
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import End
from wire.metadata import Reason


def number_of(end: End, key: int) -> int:
    """Return by which number the messages of a key of this session go, and its ids."""
    return (end.setup.session + key) % NUMBERS


def pools(end: End, opener: str, acceptor: str, key: int) -> tuple[KeyPool, KeyPool]:
    """Return the authentication keys of a key: of what the opener says, the acceptor.

    Raise SessionError if the hosts share none, or if the keys could not be stored here.
    """
    keyring = end.means.keyring
    try:
        shared = keyring.pools(opener, acceptor, number_of(end, key))
        keyring.store(acceptor if opener == keyring.host else opener)
    except (NothingShared, KeyStoreError) as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    return shared


async def stored(end: End, peer: str, key: int, keys: Alice | Bob, *, opened: bool) -> list[UUID]:
    """Keep a key that has been made; SessionError if the store does not take it."""
    assert keys.key is not None
    keyring = end.means.keyring
    work = asyncio.to_thread(keyring.keep, peer, number_of(end, key), keys.key, opened=opened)
    keeping = asyncio.create_task(work)
    try:
        return await asyncio.shield(keeping)
    except asyncio.CancelledError:  # the thread goes on, and the other end will not have them
        keyring.withdraw(peer, await keeping)
        raise
    except KeyStoreError as error:
        raise SessionError(Reason.BUSY, f"no key: {keyring.host}: {error}") from error


async def tell_of_failure(end: End, progress: Progress, ends: Sequence[Alice | Bob]) -> None:
    """Tell the application what was measured, if the error rate was; it may be gone."""
    told = summary(progress, ends)
    if told["qber"] is not None or "chsh" in told:
        with suppress(SessionError, ConnectionError):
            await end.tell(**told)
