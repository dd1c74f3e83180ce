"""Time in the table of an emulated sweep: its scale, and how much of it was software."""

from math import nan
from pathlib import Path

from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.parameters import Parameter
from qmn.results import schema
from wire.network_time import LEAST_SCALE, MOST_SCALE

TIME_SCALE = Parameter("time_scale", LEAST_SCALE, LEAST_SCALE, MOST_SCALE)
SOFTWARE = ("software_share", "software_s", "dominated_by_software")  # 1: it was, as in result.json


def of_software(folder: Path) -> Outcome:
    """Return what the result of a run that has ended says; NaN where no qubit waited."""
    result = schema.read_left(folder)
    told = {name: getattr(result, name) for name in SOFTWARE}
    return {
        name: Estimate(nan if value is None else float(value), 0.0) for name, value in told.items()
    }
