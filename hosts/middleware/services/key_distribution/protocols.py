"""The protocols of key distribution: whose light it is, and who measures what of it.

BB84 (Bennett and Brassard 1984): photons that the opener prepares. Each pulse carries a random bit
in Z (0, 1) or X (+, -); the acceptor measures it, as it arrives, in a basis of its own choice. How
often its source emits several photons is in the opener's proposal, and shortens the key
(hosts.middleware.qkd.key_length), unless the source can make decoy states
(hosts.middleware.qkd.decoy).

BBM92 (Bennett, Brassard and Mermin 1992): a source sends half of each pair Phi+ to either end; both
measure what arrives in random bases, Z or X, in which the halves agree.

E91 (Ekert 1991): as BBM92, but of some photons the acceptor takes no key: he measures them halfway
between Z and X, or Z and -X, and both ends compare. If S is not above 2 there is no key, whatever
the error rate.

MDI-QKD: both ends send pulses to a relay (relayed.py).

light.py and relayed.py decide what is done with light; here it is chosen, and carried out.
"""

from dataclasses import replace
from functools import partial

from hosts.middleware.qkd.decoy import LEVELS, Decoys
from hosts.middleware.services.key_distribution.acceptor import introduced
from hosts.middleware.services.key_distribution.light import measure_halves, prepare_and_send
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.services.key_distribution.relayed import (
    check_source,
    either,
    get_ready,
    send_to_relay,
)
from hosts.middleware.services.key_distribution.session import accept_key, accept_keys, make_key
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from wire.metadata.vocabulary import Service


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


BB84 = ServiceKind(Service.BB84, KeyOptions, open_bb84, accept_bb84)
BBM92 = ServiceKind(Service.BBM92, KeyOptions, open_bbm92, accept_bbm92)
E91 = ServiceKind(Service.E91, KeyOptions, open_e91, accept_e91)
MDI = ServiceKind(Service.MDI, KeyOptions, open_mdi, accept_mdi)
