"""Try an attack on an emulated network, without its defence and with it.

A network is made for each trial, and nothing else is attacked. See docs/attacks.md.
"""

import argparse
import sys

from evidence.attacks.laboratory import ATTACKS, LightAttack
from qmn.needs import Needs
from qmn.options import add_options
from qmn.parser import Parser
from qmn.requests.run_options import LiveOptions
from topologies.system.processes.programs import NetworkError
from topologies.system.processes.signals import Interrupted
from views.live.beside import page_of_command

EVERY = "all"
OFF, ON = "off", "on"


def names() -> dict[str, str]:
    return {name: attack.counted for name, attack in ATTACKS.items()}


def describe(parser: Parser) -> None:
    parser.description = __doc__
    parser.add_argument(
        "name", metavar="NAME", choices=[*ATTACKS, EVERY], help=", ".join([*ATTACKS, f"or {EVERY}"])
    )
    parser.add_argument("--attempts", type=int, help="how often it is tried (default: its own)")
    parser.add_argument("--defence", choices=[OFF, ON], help="only without it, or only with it")
    add_options(parser, LiveOptions)
    parser.set_defaults(call=call, needs=Needs.NETWORK)


def call(arguments: argparse.Namespace) -> int:
    if arguments.attempts is not None and not 0 < arguments.attempts <= 10_000:
        print(f"qmn: {arguments.attempts} attempts: choose 1 to 10000", file=sys.stderr)
        return 1
    shown = arguments.live or arguments.live_for_all
    if shown and isinstance(ATTACKS.get(arguments.name), LightAttack):
        print(
            f"qmn: --live: {arguments.name} is on light alone, without a network", file=sys.stderr
        )
        return 1
    tried = ATTACKS if arguments.name == EVERY else [arguments.name]
    try:
        with page_of_command(arguments.live, for_all=arguments.live_for_all):
            for name in tried:
                for defence in [arguments.defence] if arguments.defence else [OFF, ON]:
                    print(trial(name, defence, arguments.attempts), flush=True)
    except NetworkError as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    except Interrupted as error:
        print(f"qmn: {error}", file=sys.stderr)
        return error.status
    return 0


def trial(name: str, defence: str, attempts: int | None) -> str:
    """Try an attack once, in a network of its own; return its count in words."""
    attack = ATTACKS[name]
    attempts = attempts or attack.attempts
    reached, tried = attack.trial(defence == ON, attempts)
    switch = f"{attack.defence} {defence}"
    return f"{name:20} {switch:18} {reached:6} of {tried} {attack.counted}"
