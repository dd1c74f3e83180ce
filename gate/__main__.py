"""`python -m gate --config FILE`: step the time of a network."""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from gate.gate import Gate
from programs.config_argument import config_path
from wire.config import BadConfig, GateConfig


def main() -> int:
    """Step the clock until SIGTERM or SIGINT; return the exit status."""
    path = config_path("gate", __doc__)
    try:
        config = GateConfig.read(path)
        folder, leaps = Path(config.time_folder), Path(config.leaps)
        gate = Gate(folder, config.time_since_ns, leaps, watched=config.watched)
    except (BadConfig, OSError) as error:
        print(f"gate: {error}", file=sys.stderr)
        return 1
    # All wait for the gate, and the gate for a processor, for milliseconds on a busy machine.
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: gate.stop())
    print("ready", flush=True)
    gate.run()
    print(f"stopped: {gate.leaps:,} leaps, {gate.wrong:,} wrong, at {gate.clock_s:,.9f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
