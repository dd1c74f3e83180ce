"""Attack the light that goes by way of this host, and send it on.

resend: measure a fraction of the photons, and send on what was found. split: keep one photon of
each pulse that has several, and of those with one send on enough that nothing seems to be missing.

Prints a line of JSON when it has begun, one for each block, and one with the summary at a
signal (SIGTERM or SIGINT).
"""

import argparse
import json
import signal
import sys
from dataclasses import dataclass
from types import FrameType
from typing import Any

from hosts.applications.carrying import say
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from programs.faults import report_fault
from wire.socket_calls import ATTACKS, RESEND, SPLIT

SIGNALS = (signal.SIGTERM, signal.SIGINT)


@dataclass(frozen=True)
class Attack:
    fraction: float  # of the photons
    attack: str  # resend or split
    expected_db: float  # of split: loss from here to a click, as both ends expect it
    onward_db: float  # the same as it is
    stack: str | None  # socket of this host's stack; None: as the environment says

    @property
    def options(self) -> dict[str, Any]:
        losses = {"expected_db": self.expected_db, "onward_db": self.onward_db}
        return {"attack": self.attack, **(losses if self.attack == SPLIT else {})}


def intercept(attack: Attack) -> None:
    with ServiceSocket(attack.stack) as intercepting:
        blocks = intercepting.intercept(attack.fraction, **attack.options)

        def end(_number: int, _frame: FrameType | None) -> None:
            for number in SIGNALS:
                signal.signal(number, signal.SIG_IGN)
            intercepting.stop()

        for number in SIGNALS:
            signal.signal(number, end)
        say("intercepting", {"fraction": attack.fraction, **attack.options})
        for block in blocks:
            say("result", block)
        say("done", intercepting.summary)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m hosts.applications.intercept", description=__doc__
    )
    parser.add_argument("--stack", help="socket of this host's stack (QMN_STACK)")
    parser.add_argument("--attack", choices=ATTACKS, default=RESEND, help="(resend)")
    text = "split: loss from here to a click, as both ends expect it (0)"
    parser.add_argument("--expected-db", type=float, default=0.0, metavar="DB", help=text)
    text = "split: the same as it is, by the way that this host has (0)"
    parser.add_argument("--onward-db", type=float, default=0.0, metavar="DB", help=text)
    parser.add_argument("fraction", type=float, help="of the photons, 0 to 1")
    attack = Attack(**vars(parser.parse_args()))
    try:
        intercept(attack)
    except QuantumSocketError as error:
        print(json.dumps({"event": "failed", "reason": error.reason.name, "text": str(error)}))
        return report_fault(f"intercept: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
