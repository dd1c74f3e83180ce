"""qmn set HOST SETTING VALUE: override what new sessions of a host use."""

import argparse
from typing import Any

from qmn.controller_console import NoAnswer, answered, ask
from wire.device import RANGES

DEFAULT = "default"


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    parser = verbs.add_parser("set", help="override a setting of a host", description=__doc__)
    parser.add_argument("device", metavar="HOST", help="alice, bob, ...")
    names = [name.replace("_", "-") for name in RANGES]
    parser.add_argument("setting", choices=names, metavar="SETTING", help=", ".join(names))
    parser.add_argument("value", metavar="VALUE", help="a number, or `default` to undo it")
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Ask, and say what is in force."""
    return answered(lambda: change(arguments.device, arguments.setting, arguments.value))


def change(device: str, setting: str, value: str) -> None:
    """Override one setting."""
    if value != DEFAULT and not value.isdecimal():
        raise NoAnswer(f"{setting} {value!r}: give a whole number, or `{DEFAULT}`")
    name = setting.replace("-", "_")
    number = None if value == DEFAULT else int(value)
    state = ask("set", device=device, settings={name: number})
    in_force = ", ".join(f"{key} {number}" for key, number in state["overrides"].items())
    print(f"{device}: overridden in new sessions: {in_force or 'nothing'}")
