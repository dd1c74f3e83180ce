"""E91: keys by entangled pairs, and a CHSH test that decides about them (Ekert 1991).

As BBM92, but of some photons the acceptor takes no key: he measures them halfway between Z and X,
or Z and -X, and both ends compare. If S is not above 2 there is no key, whatever the error rate.
"""

from dataclasses import replace

from hosts.middleware.services.key_distribution.acceptor import AcceptorOfKeys
from hosts.middleware.services.key_distribution.bbm92 import measure_halves
from hosts.middleware.services.key_distribution.opener import OpenerOfKeys
from hosts.middleware.services.key_distribution.options import KeyOptions
from hosts.middleware.session.service import AcceptorEnd, OpenerEnd, ServiceKind
from wire.metadata import Service


async def open_e91(end: OpenerEnd, options: KeyOptions) -> None:
    """Make a key with the acceptor."""
    fraction, margin = options.chsh_fraction, options.chsh_margin
    parameters = replace(options.parameters(), chsh_fraction=fraction, chsh_margin=margin)
    await OpenerOfKeys(end, options, measure_halves, parameters).run()


async def accept_e91(end: AcceptorEnd) -> None:
    """Make a key with the opener."""
    await AcceptorOfKeys(end, half=1, tests=True).run()


KIND = ServiceKind(Service.E91, KeyOptions, open_e91, accept_e91)
