"""Points of a sweep over networks, as a program: python -m evidence.networks.point.

It reads what is asked as JSON: points of a job that share a network, or one point of an experiment
with a network of its own. It prints a line of JSON for each point as it is measured.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from evidence.curves.experiment import Outcome, SweepError
from evidence.curves.parameters import Values, point_seed
from evidence.networks import job_sweep
from evidence.networks.catalogue import MEASURED_BY
from programs.faults import report_fault
from topologies.networks.network import Interrupted, Signals


def measured(
    name: str, points: Sequence[Values], seed: int, runs: Path, signals: Signals
) -> Iterator[Outcome]:
    if name in MEASURED_BY:
        for values in points:
            yield MEASURED_BY[name](values, point_seed(name, values, seed), runs, signals)
    else:
        yield from job_sweep.measure(name, points, seed, runs)


def main() -> int:
    content = json.load(sys.stdin)
    content["runs"] = Path(content["runs"])
    try:
        with Signals() as signals:
            for outcome in measured(**content, signals=signals):
                line = {name: (each.value, each.error) for name, each in outcome.items()}
                print(json.dumps(line), flush=True)
    except (SweepError, Interrupted) as error:
        return report_fault(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
