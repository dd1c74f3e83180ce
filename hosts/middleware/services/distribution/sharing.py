"""How blocks of pairs come to both ends from a source."""

from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.session.blocks import correct_rotation
from hosts.middleware.session.protocol import HostSide, OpenerSide, Steps, coming, hear
from wire.metadata.values import Topic, Values


def make(side: OpenerSide, pairs: Pairs, number: int, size: int) -> Steps[None]:
    """Have a block of pairs made, and keep what both ends have."""
    stored = yield from side.pairs(number, size)
    yield side.say(Topic.ARRIVED, number, stored.arrived, 1)
    theirs = yield from hear(Topic.ARRIVED, number, size, 1)
    yield from pairs.share(number, stored.arrived, theirs.astype(bool))


def share(side: HostSide, pairs: Pairs, message: Values) -> Steps[None]:
    """Take in light that was announced, undo what the path did to it, keep what both ends have."""
    number, size = coming(message, side.setup.pairs)
    name = side.block(number, half=1)
    light = yield from side.expect_light(name)
    yield side.agree()
    theirs = yield from hear(Topic.ARRIVED, number, size, 1)
    stored = yield from side.stored(light, size)
    arrived = yield from correct_rotation(name, stored.arrived, side.setup.rotation)
    yield side.say(Topic.ARRIVED, number, arrived, 1)
    yield from pairs.share(number, arrived, theirs.astype(bool))
