"""Distributed sensing, as every process knows it."""

from applications.ghz.service import NEEDS_OF_LINE, LineFigures
from wire.light import ACCEPTOR, OPENER, TO_NEXT, RegisteredService


class SensingFigures(LineFigures):
    """Of distributed sensing, at its leader; None: not known yet."""

    sum_rad: float | None
    sum_error_rad: float | None
    mean_rad: float | None
    mean_error_rad: float | None
    heisenberg_limit_rad: float | None
    standard_limit_rad: float | None
    visibility: float | None


SENSE = RegisteredService(
    name="sense",
    number=14,
    title="Distributed sensing",
    light=TO_NEXT,
    needs=NEEDS_OF_LINE,
    ends="applications.sensing.ends:KIND",
    figures=(SensingFigures,),
    line=True,
    uses={OPENER: ("sensor",), ACCEPTOR: ("sensor",)},
)
