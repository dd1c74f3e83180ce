"""The session of any key distribution: from blocks of light to keys in both stores.

    opener (alice of hosts.middleware.qkd)                     acceptor (bob)
      | Envelope(OPENER), Envelope(KEYS: Proposal) -------------> |
      | Values(COMING) -----------------------------------------> |  gets ready to measure
      | <-------------------------------------------- Answer(OK)  |  one block ahead
      |   light, as the protocol makes it                         |
      | Values(OVER) -------------------------------------------> |
      | <----------------------------- Envelope(KEYS: Detections) |
      | Envelope(KEYS: Sifted) ---------------------------------> |  while the next block comes
      |   ... blocks ..., then error correction by envelopes      |
      | Finish: the opener holds the key in its store ----------> |

The acceptor stores its keys before it confirms them, and withdraws them if the session does
not end well; so the opener stores only what the acceptor has.
"""

import asyncio
from contextlib import suppress
from uuid import UUID

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.authentication import KeyPool
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.key_store import KeyStoreError
from hosts.middleware.qkd.keyring import NothingShared
from hosts.middleware.services.key_distribution.summary import Progress, summary
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import End
from wire.metadata import Reason


def pools(end: End, opener: str, acceptor: str) -> tuple[KeyPool, KeyPool]:
    """Return the authentication keys of the session: of what the opener says, the acceptor.

    Raise SessionError if the hosts share none, or if the keys could not be stored here.
    """
    keyring = end.means.keyring
    try:
        shared = keyring.pools(opener, acceptor, end.setup.session)
        keyring.store(acceptor if opener == keyring.host else opener)
    except (NothingShared, KeyStoreError) as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    return shared


async def stored(end: End, peer: str, keys: Alice | Bob, *, opened: bool) -> list[UUID]:
    """Keep the key that has been made; SessionError if the store does not take it."""
    assert keys.key is not None
    session, keyring = end.setup.session, end.means.keyring
    work = asyncio.to_thread(keyring.keep, peer, session, keys.key, opened=opened)
    keeping = asyncio.create_task(work)
    try:
        return await asyncio.shield(keeping)
    except asyncio.CancelledError:  # the thread goes on, and the other end will not have them
        keyring.withdraw(peer, await keeping)
        raise
    except KeyStoreError as error:
        raise SessionError(Reason.BUSY, f"no key: {keyring.host}: {error}") from error


async def tell_of_failure(end: End, progress: Progress, keys: Alice | Bob) -> None:
    """Tell the application what was measured, if the error rate was; it may be gone."""
    if keys.estimate is not None or keys.bell.pairs:
        with suppress(SessionError, ConnectionError):
            await end.tell(**summary(progress, keys, []))
