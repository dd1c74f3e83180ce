"""qmn: the Mininet for programmable quantum networks."""

# ruff: noqa: E402
import signal

# Until a verb runs there is nothing to clean up: Ctrl-C just ends the program, also while it loads.
signal.signal(signal.SIGINT, signal.SIG_DFL)
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # bin/qmn has blocked it

import argparse
import gc
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import Any

from qmn.machine_limits import limit_met
from qmn.needs import NoRoot, provide
from qmn.old_words import translated
from qmn.parser import Parser
from qmn.printable_text import guard_standard_streams
from qmn.project import ShowVersion, remedy
from topologies.system.processes.outputs import forget_no_width, with_outputs
from topologies.system.processes.programs import NetworkError, find_tools
from topologies.system.processes.signals import Signals
from wire.registered import VERBS as REGISTERED
from wire.registered import Registry

# Verbs of the core and what they do, by the purpose of their user; modules of qmn.verbs.
OWN: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "start a network": {
            "run": "start a network and do its job",
            "cli": "start a network with a command line",
            "script": "run a Python script, which may start networks",
            "worker": "offer this machine to networks that span several",
            "rootless": "another verb, without root of this machine",
        },
        "look at a network, or at a run": {
            "enter": "open a shell, or run a command, in a running network",
        },
        "change a running network": {
            "send": "send a text as light",
            "set": "change links, fibres, faults, eavesdroppers, settings, policy",
        },
        "use the simulator alone": {},
        "look after this machine": {
            "doctor": "check this machine",
        },
    }
)


def with_registered() -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    headings = {title: dict(verbs) for title, verbs in OWN.items()}
    places = {verb: f"qmn.verbs.{verb}" for verbs in OWN.values() for verb in verbs}
    for added in Registry[Any](REGISTERED, lambda each: isinstance(each, dict), {}).values():
        for title, verbs in added.items():
            for verb, (module, text) in verbs.items():
                if verb in places:
                    raise ImportError(f"{module}: {places[verb]} is the verb {verb}; rename one")
                headings.setdefault(title, {})[verb] = text
                places[verb] = module
    return headings, places


HEADINGS, MODULES = with_registered()
VERBS = {verb: text for verbs in HEADINGS.values() for verb, text in verbs.items()}
# Verbs that print strings of runs and of hosts, and do not move the cursor.
PRINTING = (
    *HEADINGS["look at a network, or at a run"],
    *HEADINGS["change a running network"],
    "replay",
)


class Verbs(argparse._SubParsersAction):  # type: ignore[type-arg]
    """The verbs, each with its line of the help."""

    def add_parser(self, name: str, **value: Any) -> Any:
        """Add a verb, whose description is that line, too, if it has no other."""
        text = VERBS[name]
        return super().add_parser(name, **{"description": text} | value | {"help": text})


def described(words: Sequence[str] = (), whole: bool = False) -> Parser:
    """Return a parser of the verb that is asked for; or of all, by name, or with all options.

    Only verbs with their options are loaded, which takes a second, and seconds for all.
    """
    parser = Parser(prog="qmn", description=__doc__, headings=HEADINGS)
    parser.add_argument("--version", action=ShowVersion, help="print name and version, and end")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True, action=Verbs)
    asked = VERBS if whole else [name for name in VERBS if name in words[:1]]
    for name in asked:
        import_module(MODULES[name]).add_parser(verbs)
    for name in () if asked else VERBS:
        verbs.add_parser(name)
    return parser


def main() -> int:
    forget_no_width()
    find_tools()
    status = with_outputs(run_verb)
    # All is done. Ending takes a moment, in which a signal would say otherwise.
    for number in Signals.NUMBERS:
        signal.signal(number, signal.SIG_IGN)
    return status


def run_verb() -> int:
    """Run the verb that the command line names, as root where it needs that."""
    words = translated(sys.argv[1:])
    if set(words[:1]) & set(PRINTING):
        guard_standard_streams()
    gc.disable()  # what is loaded stays: to look through it takes a tenth of the time
    arguments = described(words).parse_args(words)
    gc.freeze()
    gc.enable()
    try:
        entered = provide(arguments, words)
    except (NoRoot, NetworkError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    if entered is not None:
        return entered
    try:
        status: int = arguments.call(arguments)
    except ModuleNotFoundError as error:
        if not (missing := remedy(error)):
            raise
        print(f"qmn: {missing}", file=sys.stderr)
        return 1
    except OSError as error:
        if not (limit := limit_met(error)):
            raise
        print(f"qmn: {limit}", *getattr(error, "__notes__", ()), sep="\n", file=sys.stderr)
        return 1
    return status


if __name__ == "__main__":
    sys.exit(main())
