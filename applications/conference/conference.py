"""Conference key agreement: all hosts of a line get one secret key.

leader.py, follower.py and ghz/line.py decide; ghz/connections.py opens the sessions between
neighbours. Here keys come from the host's keyring, and go into it.
"""

from functools import partial
from uuid import UUID

from applications.conference.follower import Follower
from applications.conference.leader import Leader
from applications.conference.protocol import ConferenceOptions, Keys
from applications.ghz import connections
from applications.qkd.bits import Bits
from applications.qkd.conference import Pools
from applications.qkd.conference_proposal import ConferenceProposal
from applications.qkd.key_files import KeyStoreError
from applications.qkd.keyring import Keyring, NothingShared, keyring_of
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.errors import SessionError
from wire.metadata.vocabulary import Reason, Service

SESSIONS = 1 << 64


async def lead(end: OpenerEnd, options: ConferenceOptions) -> None:
    await connections.lead(end, options, partial(Leader, keys=_keys(keyring_of(end.resources))))


async def follow(end: AcceptorEnd) -> None:
    await connections.follow(end, partial(Follower, keys=_keys(keyring_of(end.resources))))


def _keys(keyring: Keyring) -> Keys:
    return Keys(partial(_shared, keyring), partial(_store, keyring), partial(_withdraw, keyring))


def _shared(keyring: Keyring, terms: ConferenceProposal, host: str) -> Pools:
    """Return the authentication keys of leader and host: of what this one says, of the other."""
    leader = terms.names[0]
    number = (terms.session + terms.names.index(host)) % SESSIONS
    try:
        leaders, hosts = keyring.pools(leader, host, number)
    except NothingShared as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    return (leaders, hosts) if keyring.host == leader else (hosts, leaders)


def _store(keyring: Keyring, terms: ConferenceProposal, final: Bits) -> None:
    try:
        keyring.keep_conference(terms.names, terms.session, final)
    except KeyStoreError as error:
        raise SessionError(Reason.BUSY, f"no key: {keyring.host}: {error}") from error


def _withdraw(keyring: Keyring, terms: ConferenceProposal, ids: list[UUID]) -> None:
    keyring.withdraw_conference(terms.names, ids)


KIND = ServiceKind(Service["CONFERENCE"], ConferenceOptions, lead, follow)
