"""Time in the table of an emulated sweep: its scale, and how much of it was software."""

import json
from math import nan
from pathlib import Path

from qmn.sweeps.estimates import Estimate
from qmn.sweeps.experiment import Outcome
from qmn.sweeps.parameters import Parameter
from wire.network_time import LEAST_SCALE, MOST_SCALE
from wire.results.run_result import RESULT

TIME_SCALE = Parameter("time_scale", LEAST_SCALE, LEAST_SCALE, MOST_SCALE)
SOFTWARE = ("software_share", "software_s", "dominated_by_software")  # 1: it was, as in result.json


def of_software(folder: Path) -> Outcome:
    """Return what the result of a run that has ended says; NaN where no qubit waited."""
    told = json.loads((folder / RESULT).read_text())
    return {
        name: Estimate(nan if told[name] is None else float(told[name]), 0.0) for name in SOFTWARE
    }
