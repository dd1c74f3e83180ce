"""`python -m copper --config FILE`: delay packets by the length of their cable."""

import signal
import sys

from copper.forwarder import Forwarder
from programs.config_argument import config_path
from programs.faults import report_fault
from wire.config import BadConfig, CopperConfig


def main() -> int:
    """Forward until SIGTERM or SIGINT; return the exit status."""
    path = config_path("copper", __doc__)
    try:
        forwarder = Forwarder(CopperConfig.read(path))
    except (BadConfig, OSError) as error:
        return report_fault(f"copper: {error}")
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: forwarder.stop())
    print("ready", flush=True)
    forwarder.run()
    forwarder.close()
    print(f"stopped: {forwarder.held:,} packets held, {forwarder.lost:,} lost")
    return 0


if __name__ == "__main__":
    sys.exit(main())
