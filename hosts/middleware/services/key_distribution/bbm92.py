"""BBM92: keys by entangled pairs (Bennett, Brassard and Mermin 1992).

A source sends half of each pair Phi+ to either end; both measure what arrives in random
bases, Z or X, in which the halves agree.
"""

from hosts.middleware.qkd.sifting import Record
from hosts.middleware.services.key_distribution.acceptor import AcceptorOfKeys
from hosts.middleware.services.key_distribution.light import measured, measuring, random_bases
from hosts.middleware.services.key_distribution.opener import OpenerOfKeys
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.session.service import AcceptorEnd, OpenerEnd, ServiceKind
from wire.metadata import Service


async def measure_halves(end: OpenerEnd, number: int, pairs: int) -> Record:
    """Have the source make a block of pairs; return what was measured of half 0."""
    bases = random_bases(end, pairs)
    light = measuring(end, end.block(number), bases)
    try:
        await end.arrangement.emit(number, pairs)
        return Record(bases, await measured(end, light, pairs))
    finally:
        light.cancel()


async def open_bbm92(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor."""
    await OpenerOfKeys(end, options, measure_halves, options.parameters()).run()


async def accept_bbm92(end: AcceptorEnd) -> None:
    """Make a key with the opener."""
    await AcceptorOfKeys(end, half=1).run()


KIND = ServiceKind(Service.BBM92, KeyOptions, open_bbm92, accept_bbm92)
