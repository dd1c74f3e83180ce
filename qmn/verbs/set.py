"""qmn set HOST SETTING VALUE: override what new sessions of a host use."""

import argparse
from typing import Any

from qmn.needs import Needs
from qmn.running.controller_console import NoAnswer, answered, ask
from wire.device import RANGES, setting_number

DEFAULT = "default"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("set", description=__doc__)
    parser.add_argument("device", metavar="HOST", help="alice, bob, ...")
    names = [name.replace("_", "-") for name in RANGES]
    parser.add_argument("setting", choices=names, metavar="SETTING", help=", ".join(names))
    parser.add_argument(
        "value", metavar="VALUE", help="a number, a name (fec golay), or `default` to undo it"
    )
    parser.set_defaults(call=call, needs=Needs.RUNNING)


def call(arguments: argparse.Namespace) -> int:
    return answered(lambda: change(arguments.device, arguments.setting, arguments.value))


def change(device: str, setting: str, value: str) -> None:
    name = setting.replace("-", "_")
    try:
        number = None if value == DEFAULT else _number(name, value)
    except ValueError as error:
        raise NoAnswer(f"{error}, or `{DEFAULT}`") from error
    state = ask("set", device=device, settings={name: number})
    in_force = ", ".join(f"{key} {number}" for key, number in state["overrides"].items())
    print(f"{device}: overridden in new sessions: {in_force or 'nothing'}")


def _number(name: str, value: str) -> int | None:
    return setting_number(name, int(value) if value.isdecimal() else value)
