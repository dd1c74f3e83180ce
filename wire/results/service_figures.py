"""The figures of services of `qmn run`, whose figures are kept as they come."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING

from wire.light import registered_services
from wire.results.figures import (
    Figures,
    PairFigures,
    ReceiverFigures,
    SentFigures,
)

if TYPE_CHECKING:
    ServiceFigures = Figures
else:
    ServiceFigures = reduce(
        or_,
        (kind for service in registered_services() for kind in service.figures),
        Figures | PairFigures | SentFigures | ReceiverFigures,
    )
