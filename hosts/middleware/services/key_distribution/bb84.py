"""BB84: keys by photons that the opener prepares (Bennett and Brassard 1984).

Each pulse carries a random bit in Z (0, 1) or X (+, -); the acceptor measures it, as it arrives,
in a basis of its own choice. How often its source emits several photons is told by the opener, and
shortens the key (hosts.middleware.qkd.key_length), unless the source can make decoy states
(hosts.middleware.qkd.decoy).
"""

from dataclasses import replace

import numpy as np

from hosts.middleware.qkd.decoy import LEVELS, SHARES, Decoys
from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.acceptor import AcceptorOfKeys
from hosts.middleware.services.key_distribution.light import random_bases
from hosts.middleware.services.key_distribution.opener import OpenerOfKeys
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.session.service import AcceptorEnd, OpenerEnd, ServiceKind
from wire.metadata import Service


async def prepare_and_send(end: OpenerEnd, number: int, photons: int) -> Record:
    """Send a block of random states; return their bases and bits when it has arrived."""
    setup, bases = end.setup, random_bases(end, photons)
    bits = end.draws.integers(0, 2, photons, dtype=bases.dtype)
    levels = None
    if decoys_of(end) is not None:
        levels = end.draws.choice(LEVELS, photons, p=SHARES).astype(np.uint8)
    block = await end.qnic.prepare(setup.session, number, 2 * bases + bits, levels)
    await end.qnic.send(block, end.qnic.ports[0], setup.rate_hz, setup.wavelength_pm)
    return Record(bases, bits, levels)


def decoys_of(end: OpenerEnd) -> Decoys | None:
    """Return the decoy states that this host's source can make; None: none."""
    means = end.means.intensities
    return Decoys(means) if len(means) == LEVELS else None


async def open_bb84(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor."""
    parameters = replace(options.parameters(), multi_photon=end.means.multi_photon)
    await OpenerOfKeys(end, options, prepare_and_send, parameters, decoys_of(end)).run()


async def accept_bb84(end: AcceptorEnd) -> None:
    """Make a key with the opener."""
    await AcceptorOfKeys(end, half=0).run()


KIND = ServiceKind(Service.BB84, KeyOptions, open_bb84, accept_bb84)
