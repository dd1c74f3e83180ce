"""One point of an emulated sweep, as a program: python -m evidence.networks.point.

It reads what is asked, and says what was measured, both as JSON.
"""

import json
import sys
from pathlib import Path

from evidence.curves.experiment import SweepError
from evidence.networks.catalogue import MEASURED_BY
from programs.faults import report_fault
from topologies.networks.network import Interrupted, Signals


def main() -> int:
    asked = json.load(sys.stdin)
    measure = MEASURED_BY[asked["name"]]
    try:
        with Signals() as signals:
            outcome = measure(asked["values"], asked["seed"], Path(asked["runs"]), signals)
    except (SweepError, Interrupted) as error:
        return report_fault(str(error))
    json.dump({name: (each.value, each.error) for name, each in outcome.items()}, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
