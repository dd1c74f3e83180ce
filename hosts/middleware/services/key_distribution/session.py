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
opener.py and acceptor.py decide what is said and when; here it is carried out.
"""

import asyncio
from contextlib import suppress
from uuid import UUID

from hosts.middleware.qkd.alice import Alice
from hosts.middleware.qkd.authentication import KeyPool
from hosts.middleware.qkd.bob import Bob
from hosts.middleware.qkd.decoy import Decoys
from hosts.middleware.qkd.end import Terms
from hosts.middleware.qkd.key_store import KeyStoreError
from hosts.middleware.qkd.keyring import NothingShared
from hosts.middleware.qkd.parameters import Parameters
from hosts.middleware.services.key_distribution.acceptor import AcceptorOfKeys, introduced
from hosts.middleware.services.key_distribution.opener import Light, OpenerOfKeys
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.services.key_distribution.summary import Progress, summary
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.service import AcceptorEnd, End, OpenerEnd
from hosts.network_loop import now_s
from wire.metadata import Reason


async def make_key(
    end: OpenerEnd,
    options: KeyOptions,
    light: Light,
    parameters: Parameters,
    decoys: Decoys | None = None,
) -> None:
    """Make a key of this light, by these parameters, or whose pulses are decoys."""
    peer, ids, progress = end.arrangement.peer, list[UUID](), Progress(now_s())
    outgoing, incoming = pools(end, end.resources.keyring.host, peer)
    terms = Terms(end.setup.session, parameters, outgoing, incoming, end.draws.bytes)
    alice = Alice(terms, decoys)

    async def store() -> None:
        ids.extend(await stored(end, peer, alice, opened=True))

    protocol = OpenerOfKeys(end.side, options.count, light, alice, progress, store)
    try:
        await end.perform(protocol.run())
    except SessionError:
        await tell_of_failure(end, progress, alice)
        raise
    end.summary = summary(progress, alice, ids, now_s())


async def accept_key(end: AcceptorEnd, half: int, *, tests: bool = False) -> None:
    """Make a key of what is measured of this half; tests: some photons are for a CHSH test."""
    ids, progress = list[UUID](), Progress(now_s())
    opener = await end.perform(introduced(tests))
    incoming, outgoing = pools(end, opener.peer, end.resources.keyring.host)
    draws = end.draws.bytes
    bob = Bob(Terms(end.setup.session, opener.parameters, outgoing, incoming, draws))

    async def store() -> None:
        ids.extend(await stored(end, opener.peer, bob, opened=False))

    try:
        protocol = AcceptorOfKeys(end.side, half, opener, bob, progress, store)
        await end.perform(protocol.run())
    except BaseException as error:
        end.resources.keyring.withdraw(opener.peer, ids)
        if isinstance(error, SessionError):
            await tell_of_failure(end, progress, bob)
        raise
    end.summary = summary(progress, bob, ids, now_s())


def pools(end: End, opener: str, acceptor: str) -> tuple[KeyPool, KeyPool]:
    """Return the authentication keys of the session: of what the opener says, the acceptor.

    Raise SessionError if the hosts share none, or if the keys could not be stored here.
    """
    keyring = end.resources.keyring
    try:
        shared = keyring.pools(opener, acceptor, end.setup.session)
        keyring.store(acceptor if opener == keyring.host else opener)
    except (NothingShared, KeyStoreError) as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    return shared


async def stored(end: End, peer: str, keys: Alice | Bob, *, opened: bool) -> list[UUID]:
    """Keep the key that has been made; SessionError if the store does not take it."""
    assert keys.key is not None
    session, keyring = end.setup.session, end.resources.keyring
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
            await end.tell(**summary(progress, keys, [], now_s()))
