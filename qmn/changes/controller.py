"""Changes that the controller makes: `qmn set host` and `qmn set policy`."""

import argparse

from qmn.running.controller_console import NoAnswer, answered, ask
from wire.device import RANGES, setting_number

DEFAULT = "default"


def describe_host(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("host", metavar="HOST", help="alice, bob, ...")
    names = [name.replace("_", "-") for name in RANGES]
    parser.add_argument("setting", choices=names, metavar="SETTING", help=", ".join(names))
    parser.add_argument(
        "value", metavar="VALUE", help="a number, a name (fec golay), or `default` to undo it"
    )
    parser.set_defaults(call=call_host)


def call_host(arguments: argparse.Namespace) -> int:
    return answered(lambda: set_host(arguments.host, arguments.setting, arguments.value))


def set_host(host: str, setting: str, value: str) -> None:
    """Override a setting for new sessions of a host; raise NoAnswer for a bad value."""
    name = setting.replace("-", "_")
    try:
        number = None if value == DEFAULT else _number(name, value)
    except ValueError as error:
        raise NoAnswer(f"{error}, or `{DEFAULT}`") from error
    state = ask("set", device=host, settings={name: number})
    in_force = ", ".join(f"{key} {number}" for key, number in state["overrides"].items())
    print(f"{host}: overridden in new sessions: {in_force or 'nothing'}")


def _number(name: str, value: str) -> int | None:
    return setting_number(name, int(value) if value.isdecimal() else value)


def describe_policy(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "what", metavar="reload", choices=["reload"], help="overrides become those of the file"
    )
    parser.set_defaults(call=reload_policy)


def reload_policy(_arguments: argparse.Namespace) -> int:
    return answered(lambda: print(f"in force: {ask('reload-policy')['policy']}"))
