"""A controller that times the one switch that connects to it, and prints milliseconds as JSON.

python -m evidence.bench.path_baseline FRAMEWORK ADDRESS:PORT learning|bundle|full COUNT [OPTION…]

See evidence/bench/baseline_app.py for what is timed.
"""

import argparse
import json
import os

from controller_apps.__main__ import load_framework, read_address, wait_until_listening
from qmn.timeouts import MEASURE_TIMEOUT_S

WHAT = ("learning", "bundle", "full")


def main() -> None:
    """Serve one switch until all is measured."""
    parser = argparse.ArgumentParser(
        prog="python -m evidence.bench.path_baseline", description=__doc__
    )
    parser.add_argument("framework")
    parser.add_argument("listen")
    parser.add_argument("what", choices=WHAT)
    parser.add_argument("count", type=int)
    parser.add_argument("--ports", type=int, default=0, help="of the switch, numbered from 1")
    parser.add_argument("--period-s", type=float, default=0.0, help="from turn to turn at least")
    arguments = parser.parse_args()
    framework = load_framework(arguments.framework)
    host, port = read_address("listen", arguments.listen)
    framework.serve_on(host, port)
    apps = framework.start(
        ["evidence.bench.baseline_app"],
        what=arguments.what,
        count=arguments.count,
        ports=arguments.ports,
        period_s=arguments.period_s,
    )
    wait_until_listening(framework, host, port)
    print("ready", flush=True)
    print(json.dumps(apps["Baseline"].times_ms.get(timeout=MEASURE_TIMEOUT_S)), flush=True)


if __name__ == "__main__":
    main()
    os._exit(0)  # threads that wait for switches cannot be interrupted
