"""Changes of all fibres between two nodes: `qmn set tap`, `classical` and `calibrate`."""

import argparse
from typing import Any

from qmn.changes.change import ask_dispatcher, reported
from qmn.running.network import dispatcher_of_running_network
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import AdjustFiberRequest


def describe_tap(parser: argparse.ArgumentParser) -> None:
    _add_nodes(parser)
    text = "of the photons that she measures in Z or X and sends on; 0: no eavesdropper"
    parser.add_argument("fraction", type=float, metavar="FRACTION", help=text)
    parser.set_defaults(call=tap)


def describe_classical(parser: argparse.ArgumentParser) -> None:
    _add_nodes(parser)
    parser.add_argument("power_mw", type=float, metavar="MW", help="launched into each; 0: none")
    parser.set_defaults(call=classical)


def describe_calibrate(parser: argparse.ArgumentParser) -> None:
    _add_nodes(parser)
    parser.set_defaults(call=calibrate)


def _add_nodes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", metavar="NODE", help="one end of the fibres, as alice")
    parser.add_argument("b", metavar="NODE", help="their other end, as q1")


def tap(arguments: argparse.Namespace) -> int:
    fraction = arguments.fraction
    effect = f"{fraction:g} of the photons are measured and sent on"
    return _adjust(arguments, effect, tapped=fraction)


def classical(arguments: argparse.Namespace) -> int:
    power_mw = arguments.power_mw
    return _adjust(arguments, f"classical light of {power_mw:g} mW", classical_mw=power_mw)


def calibrate(arguments: argparse.Namespace) -> int:
    return _adjust(arguments, "calibrated", calibrate=True)


def _adjust(arguments: argparse.Namespace, effect: str, **adjustment: Any) -> int:
    a, b = arguments.a, arguments.b

    def change() -> str:
        request = AdjustFiberRequest(a=a, b=b, **adjustment)
        count = adjust(dispatcher_of_running_network(), request)
        return f"{'1 fibre' if count == 1 else f'{count} fibres'} between {a} and {b}: {effect}"

    return reported(change)


def adjust(config: DispatcherConfig, request: AdjustFiberRequest) -> int:
    """Return the number of fibres adjusted; raise BadChange or NetworkError."""
    return int(ask_dispatcher(config, "AdjustFiber", request).fibers)
