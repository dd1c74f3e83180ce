"""The protocols of key distribution: whose light it is, and who measures what of it.

BB84 (Bennett and Brassard 1984): photons that the opener prepares. Each pulse carries a random bit
in Z (0, 1) or X (+, -); the acceptor measures it, as it arrives, in a basis of its own choice. How
often its source emits several photons is told by the opener, and shortens the key
(hosts.middleware.qkd.key_length), unless the source can make decoy states
(hosts.middleware.qkd.decoy).

BBM92 (Bennett, Brassard and Mermin 1992): a source sends half of each pair Phi+ to either end; both
measure what arrives in random bases, Z or X, in which the halves agree.

E91 (Ekert 1991): as BBM92, but of some photons the acceptor takes no key: he measures them halfway
between Z and X, or Z and -X, and both ends compare. If S is not above 2 there is no key, whatever
the error rate.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from hosts.hardware.qnic import Qnic
from hosts.middleware.qkd.decoy import LEVELS, SHARES, Decoys
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.light import measured, measuring, random_bases
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.services.key_distribution.session import accept_key, make_key
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.protocol import Emit, OpenerSide, Steps, do
from wire.metadata.vocabulary import Service


def prepare_and_send(
    side: OpenerSide, number: int, photons: int, *, with_decoys: bool
) -> Steps[Record]:
    """Send a block of random states; return their bases and bits when it has left."""
    setup, bases = side.setup, random_bases(side, photons)
    bits = side.draws.integers(0, 2, photons, dtype=bases.dtype)
    levels = None
    if with_decoys:
        levels = side.draws.choice(LEVELS, photons, p=SHARES).astype(np.uint8)
    block = yield from do(Qnic.prepare, setup.session, number, 2 * bases + bits, levels)
    yield from do(Qnic.send, block, side.ports[0], setup.rate_hz, setup.wavelength_pm)
    return Record(bases, bits, levels)


def measure_halves(side: OpenerSide, number: int, pairs: int) -> Steps[Record]:
    """Have the source make a block of pairs; return what was measured of half 0."""
    bases = random_bases(side, pairs)
    light = yield from measuring(side, side.block(number), bases)
    yield Emit(number, pairs)
    return Record(bases, (yield from measured(side, light, pairs)))


async def open_bb84(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor, of decoy states if this host's source can make them."""
    parameters = replace(options.parameters(), multi_photon=end.resources.multi_photon)
    intensities = end.resources.intensities
    decoys = Decoys(intensities) if len(intensities) == LEVELS else None
    light = partial(prepare_and_send, with_decoys=decoys is not None)
    await make_key(end, options, light, parameters, decoys)


async def accept_bb84(end: AcceptorEnd) -> None:
    """Make a key with the opener."""
    await accept_key(end, half=0)


async def open_bbm92(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor."""
    await make_key(end, options, measure_halves, options.parameters())


async def accept_bbm92(end: AcceptorEnd) -> None:
    """Make a key with the opener."""
    await accept_key(end, half=1)


async def open_e91(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor."""
    fraction, margin = options.chsh_fraction, options.chsh_margin
    parameters = replace(options.parameters(), chsh_fraction=fraction, chsh_margin=margin)
    await make_key(end, options, measure_halves, parameters)


async def accept_e91(end: AcceptorEnd) -> None:
    """Make a key with the opener."""
    await accept_key(end, half=1, tests=True)


BB84 = ServiceKind(Service.BB84, KeyOptions, open_bb84, accept_bb84)
BBM92 = ServiceKind(Service.BBM92, KeyOptions, open_bbm92, accept_bbm92)
E91 = ServiceKind(Service.E91, KeyOptions, open_e91, accept_e91)
