"""Conference keys, as every process knows them."""

from applications.ghz.service import NEEDS_OF_LINE, FollowerFigures, LineFigures
from wire.light import TO_NEXT, RegisteredService


class ConferenceFigures(LineFigures):
    """Of conference key agreement, at its leader; never a key."""

    raw_bits: int
    tests_in_x: int
    qber_x: float
    tests_in_z: int
    qber_z: list[float]  # of each other host
    leaked_bits: int
    key_bits: int
    key_fraction: float
    key_fraction_limit: float
    bound: str
    assumed: str
    keys: int
    bits_of_a_key: int
    first_key_id: str | None
    last_key_id: str | None
    authentication_bits: int
    net_key_bits: int
    key_bits_per_s: float


class ConferenceFollowerFigures(FollowerFigures):
    """Of conference key agreement, at another host."""

    key_bits: int
    keys: int
    first_key_id: str | None


CONFERENCE = RegisteredService(
    name="conference",
    number=15,
    title="Conference keys",
    light=TO_NEXT,
    needs=NEEDS_OF_LINE,
    ends="applications.conference.conference:KIND",
    figures=(ConferenceFigures, ConferenceFollowerFigures),
    line=True,
)
