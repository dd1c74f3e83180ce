"""`python -m copper --config FILE`: hold every packet as long as its cable is long."""

import argparse
import signal
import sys
from pathlib import Path

from copper.forwarder import Forwarder
from wire.config import BadConfig, CopperConfig


def main() -> int:
    """Forward until SIGTERM or SIGINT; return the exit status."""
    parser = argparse.ArgumentParser(prog="copper", description=__doc__)
    parser.add_argument("--config", type=Path, required=True, help="written by the runner")
    try:
        forwarder = Forwarder(CopperConfig.read(parser.parse_args().config))
    except (BadConfig, OSError) as error:
        print(f"copper: {error}", file=sys.stderr)
        return 1
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: forwarder.stop())
    print("ready", flush=True)
    forwarder.run()
    print(f"stopped: {forwarder.held:,} packets held, {forwarder.lost:,} lost")
    return 0


if __name__ == "__main__":
    sys.exit(main())
