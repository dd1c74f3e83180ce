"""The session of any key distribution: from blocks of light to keys in both stores.

    opener (alice of applications.qkd)                     acceptor (bob)
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
opener.py and acceptor.py decide on the messages; here they are carried out.

The protocols of key distribution: whose light it is, and who measures what of it.

BB84 (Bennett and Brassard 1984): photons that the opener prepares. Each pulse carries a random bit
in Z (0, 1) or X (+, -); the acceptor measures it, as it arrives, in a basis of its own choice. How
often its source emits several photons is in the opener's proposal, and shortens the key
(applications.qkd.key_length), unless the source can make decoy states
(applications.qkd.decoy).

BBM92 (Bennett, Brassard and Mermin 1992): a source sends half of each pair Phi+ to either end; both
measure what arrives in random bases, Z or X, in which the halves agree.

E91 (Ekert 1991): as BBM92, but of some photons the acceptor takes no key: he measures them halfway
between Z and X, or Z and -X, and both ends compare. If S is not above 2 there is no key, whatever
the error rate.

MDI-QKD: both ends send pulses to a relay (relayed.py).

light.py and relayed.py decide what is done with light; here it is chosen, and carried out.
"""

import asyncio
from contextlib import suppress
from dataclasses import replace
from functools import partial
from uuid import UUID

from applications.key_distribution.acceptor import (
    AcceptorOfKeys,
    GetReady,
    Introduced,
    introduced,
    measuring_half,
)
from applications.key_distribution.light import measure_halves, prepare_and_send
from applications.key_distribution.opener import Light, OpenerOfKeys
from applications.key_distribution.options import KeyOptions
from applications.key_distribution.relayed import check_source, either, get_ready, send_to_relay
from applications.key_distribution.summary import Progress, summary
from applications.key_distribution.under_way import NUMBERS, KeysUnderWay
from applications.qkd.alice import Alice
from applications.qkd.authentication import KeyPool
from applications.qkd.bits import Bits
from applications.qkd.bob import Bob
from applications.qkd.decoy import LEVELS, Decoys
from applications.qkd.end import Terms
from applications.qkd.key_files import KeyStoreError
from applications.qkd.key_store import StoreFull
from applications.qkd.keyring import Keyring, NothingShared, keyring_of
from applications.qkd.parameters import Parameters
from applications.timeouts import CAPACITY_LOOK_S, CAPACITY_TIMEOUT_S
from hosts.middleware.session.ends import AcceptorEnd, End, OpenerEnd, ServiceKind
from hosts.middleware.session.errors import SessionError
from hosts.network_loop import now_s
from wire.metadata.vocabulary import Reason, Service


async def make_key(
    end: OpenerEnd,
    options: KeyOptions,
    light: Light,
    parameters: Parameters,
    decoys: Decoys | None = None,
    *,
    relayed: bool = False,
) -> None:
    host, peer = keyring_of(end.resources).host, end.arrangement.peer
    progress = Progress(now_s(), max_qber=parameters.max_qber)

    def new_key(number: int) -> Alice:
        outgoing, incoming = pools(end, host, peer, number)
        key_terms = terms(end, number, parameters, outgoing, incoming, relayed=relayed)
        return Alice(key_terms, decoys)

    store = partial(stored, end, peer, asyncio.Lock(), opened=True)
    protocol = OpenerOfKeys(end.side, options, light, new_key, progress, store)
    try:
        await end.perform_together(protocol.run())
    except SessionError as error:
        await give_up(end, protocol.keys, progress, error)
        raise
    end.summary = summary(progress, (), now_s())


async def accept_key(end: AcceptorEnd, half: int, *, tests: bool = False) -> None:
    """Make keys of what is measured of this half; tests: some photons are for a CHSH test."""
    opener = await end.perform(introduced(tests))
    tested = opener.parameters.chsh_fraction
    await accept_keys(end, opener, partial(measuring_half, half=half, tested=tested))


async def accept_keys(
    end: AcceptorEnd,
    opener: Introduced,
    light: GetReady,
    decoys: Decoys | None = None,
    *,
    relayed: bool = False,
) -> None:
    """Make keys of this light, of which pulses that this end sends to a relay may be decoys."""
    progress = Progress(now_s(), max_qber=opener.parameters.max_qber)

    def new_key(number: int) -> Bob:
        incoming, outgoing = pools(end, opener.peer, keyring_of(end.resources).host, number)
        key_terms = terms(end, number, opener.parameters, outgoing, incoming, relayed=relayed)
        return Bob(key_terms, decoys)

    store = partial(stored, end, opener.peer, asyncio.Lock(), opened=False)
    protocol = AcceptorOfKeys(end.side, light, opener, new_key, progress, store)
    try:
        await end.perform_together(protocol.run())
    except BaseException as error:
        for ids in protocol.not_kept.values():
            keyring_of(end.resources).withdraw(opener.peer, ids)
        if isinstance(error, SessionError):
            await give_up(end, protocol.keys, progress, error)
        raise
    end.summary = summary(progress, (), now_s())


def number_of(end: End, key: int) -> int:
    return (end.setup.session + key) % NUMBERS


def terms(
    end: End,
    key: int,
    parameters: Parameters,
    outgoing: KeyPool,
    incoming: KeyPool,
    *,
    relayed: bool,
) -> Terms:
    """Return what this end of a key is given; its random bytes follow from the seed."""
    draws = end.draws.spawn(1)[0]
    return Terms(number_of(end, key), parameters, outgoing, incoming, draws.bytes, relayed)


def pools(end: End, opener: str, acceptor: str, key: int) -> tuple[KeyPool, KeyPool]:
    """Return the authentication keys of a key: of what the opener says, the acceptor.

    Raise SessionError if the hosts share none, or if the keys could not be stored here.
    """
    keyring = keyring_of(end.resources)
    try:
        shared = keyring.pools(opener, acceptor, number_of(end, key))
        keyring.store(acceptor if opener == keyring.host else opener)
    except (NothingShared, KeyStoreError) as error:
        raise SessionError(Reason.NOT_ALLOWED, f"no key: {error}") from error
    return shared


async def stored(
    end: End, peer: str, turn: asyncio.Lock, key: int, keys: Alice | Bob, *, opened: bool
) -> list[UUID]:
    """Keep a key that has been made; SessionError if the store does not take it.

    A full store may be one from which keys are taken: it is given some time.
    """
    assert keys.key is not None
    keyring, deadline_s = keyring_of(end.resources), now_s() + CAPACITY_TIMEOUT_S
    while True:
        try:
            async with turn:  # the room that one key has found is not another's
                return await kept(keyring, peer, number_of(end, key), keys.key, opened=opened)
        except KeyStoreError as error:
            if not isinstance(error, StoreFull) or now_s() > deadline_s:
                raise SessionError(Reason.BUSY, f"no key: {keyring.host}: {error}") from error
        await asyncio.sleep(CAPACITY_LOOK_S)


async def kept(keyring: Keyring, peer: str, number: int, key: Bits, *, opened: bool) -> list[UUID]:
    """Have a thread keep a key; who is cancelled meanwhile withdraws it."""
    work = asyncio.to_thread(keyring.keep, peer, number, key, opened=opened)
    keeping = asyncio.create_task(work)
    try:
        return await asyncio.shield(keeping)
    except asyncio.CancelledError:  # the thread goes on, and the other end will not have them
        keyring.withdraw(peer, await keeping)
        raise


async def give_up(end: End, keys: KeysUnderWay, progress: Progress, error: SessionError) -> None:
    """Tell the other end that keys will not be made, and the application what was measured."""
    for last in keys.give_up(str(error)):
        end.channel.send(*last.messages)
    figures = summary(progress, keys.ends, now_s())
    if figures.qber is not None or figures.chsh_pairs:
        with suppress(SessionError, ConnectionError):  # it may be gone
            await end.tell(**vars(figures))


async def open_bb84(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor, of decoy states if this host's source can make them."""
    parameters = replace(options.parameters(), multi_photon=end.resources.multi_photon)
    decoys = _decoys(end.resources.intensities)
    light = partial(prepare_and_send, with_decoys=decoys is not None)
    await make_key(end, options, light, parameters, decoys)


async def accept_bb84(end: AcceptorEnd) -> None:
    await accept_key(end, half=0)


async def open_bbm92(end: OpenerEnd, options: KeyOptions) -> None:
    await make_key(end, options, measure_halves, options.parameters())


async def accept_bbm92(end: AcceptorEnd) -> None:
    await accept_key(end, half=1)


async def open_e91(end: OpenerEnd, options: KeyOptions) -> None:
    fraction, margin = options.chsh_fraction, options.chsh_margin
    parameters = replace(options.parameters(), chsh_fraction=fraction, chsh_margin=margin)
    await make_key(end, options, measure_halves, parameters)


async def accept_e91(end: AcceptorEnd) -> None:
    await accept_key(end, half=1, tests=True)


async def open_mdi(end: OpenerEnd, options: KeyOptions) -> None:
    decoys, several = _decoys(end.resources.intensities), end.resources.multi_photon
    parameters = replace(options.parameters(), multi_photon=either(several, several))
    light = partial(send_to_relay, decoys=decoys is not None)
    await make_key(end, options, light, parameters, decoys, relayed=True)


async def accept_mdi(end: AcceptorEnd) -> None:
    """Make a key with the opener, whose source is as this one, or emits several photons more."""
    opener = await end.perform(introduced(tests=False))
    decoys, several = _decoys(end.resources.intensities), end.resources.multi_photon
    if decoys is None:
        check_source(opener, end.resources.name, several)
    light = partial(get_ready, decoys=decoys is not None)
    await accept_keys(end, opener, light, decoys, relayed=True)


def _decoys(intensities: tuple[float, ...]) -> Decoys | None:
    return Decoys(intensities) if len(intensities) == LEVELS else None


BB84 = ServiceKind(Service["BB84"], KeyOptions, open_bb84, accept_bb84)
BBM92 = ServiceKind(Service["BBM92"], KeyOptions, open_bbm92, accept_bbm92)
E91 = ServiceKind(Service["E91"], KeyOptions, open_e91, accept_e91)
MDI = ServiceKind(Service["MDI"], KeyOptions, open_mdi, accept_mdi)
