"""Run one host's q0: python -m applications.ip_over_light --config FILE."""

import logging
import os
import queue
import signal
import sys

from applications.ip_over_light.format import INTERFACE, IpOverLightConfig
from applications.ip_over_light.interface import Interface
from applications.ip_over_light.tun import Tun, TunError
from programs.config_argument import config_path
from programs.faults import report_fault
from wire.config import BadConfig


def run(config: IpOverLightConfig) -> int:
    """Carry packets until a signal, or until a part fails."""
    ended: queue.SimpleQueue[BaseException | None] = queue.SimpleQueue()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: ended.put(None))
    addresses = [f"{config.address}/{config.prefix_length}"]
    if config.address6:
        addresses.append(f"{config.address6}/{config.prefix6_length}")
    tun = Tun(INTERFACE, addresses, config.mtu)
    interface = Interface(config, tun, ended.put)
    interface.start()
    print("ready", flush=True)
    error = ended.get()
    interface.close()
    if error is not None:
        return report_fault(f"q0: {error}")
    return 0


def main() -> int:
    path = config_path("python -m applications.ip_over_light", __doc__)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        return run(IpOverLightConfig.read(path))
    except (BadConfig, TunError, OSError) as error:  # QuantumSocketError is an OSError
        return report_fault(f"q0: {error}")


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # threads that wait for light need not end
