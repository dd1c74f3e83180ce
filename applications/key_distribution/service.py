"""Key distribution of two hosts, by four protocols, as every process knows it."""

from wire.features import EMIT, INTERFERE, MEASURE
from wire.light import ACCEPTOR, OPENER, PAIRS, SOURCE, Beam, FiberOf, RegisteredService
from wire.results.figures import KeyFigures, KeyProgress

ENDS = "applications.key_distribution.session"

BB84 = RegisteredService(
    name="bb84",
    number=6,
    title="BB84",
    light=(Beam(FiberOf(OPENER, 0), FiberOf(ACCEPTOR, 0)),),
    needs={OPENER: EMIT, ACCEPTOR: MEASURE},
    ends=f"{ENDS}:BB84",
    figures=(KeyProgress, KeyFigures),
    prepares_states=True,
    by_key=True,
)
BBM92 = RegisteredService(
    name="bbm92",
    number=5,
    title="BBM92",
    light=PAIRS,
    needs={SOURCE: EMIT, OPENER: MEASURE, ACCEPTOR: MEASURE},
    ends=f"{ENDS}:BBM92",
    by_key=True,
)
E91 = RegisteredService(
    name="e91",
    number=12,
    title="E91",
    light=PAIRS,
    needs={SOURCE: EMIT, OPENER: MEASURE, ACCEPTOR: MEASURE},
    ends=f"{ENDS}:E91",
)
MDI = RegisteredService(
    name="mdi",
    number=13,
    title="MDI-QKD",
    light=(
        Beam(FiberOf(OPENER, 0), FiberOf(SOURCE, 0)),
        Beam(FiberOf(ACCEPTOR, 0), FiberOf(SOURCE, 1)),
    ),
    needs={SOURCE: INTERFERE, OPENER: EMIT, ACCEPTOR: EMIT},
    ends=f"{ENDS}:MDI",
    prepares_states=True,
    third="a relay between both ends",
    uses={SOURCE: ("memory",)},
)
