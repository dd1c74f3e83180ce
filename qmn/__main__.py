"""qmn: the Mininet for programmable quantum networks."""

import argparse
import gc
import signal
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import MappingProxyType

from qmn.as_root import NoRoot, become_root
from qmn.machine_limits import limit_met
from qmn.parser import Parser
from qmn.printable_text import guard_standard_streams
from qmn.version import ShowVersion
from topologies.system.processes.outputs import forget_no_width, with_outputs
from topologies.system.processes.signals import Signals

# Until a verb runs there is nothing to clean up: Ctrl-C just ends the program.
signal.signal(signal.SIGINT, signal.SIG_DFL)

# By what somebody wants to do; each is a module of qmn.verbs.
HEADINGS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "start a network": ("run", "cli", "script", "netqasm", "apart", "worker"),
        "look at a network, or at a run": (
            "devices",
            "paths",
            "keys",
            "spy",
            "live",
            "wireshark",
            "report",
            "runs",
            "share",
        ),
        "change a running network": (
            "send",
            "link",
            "set",
            "policy",
            "fault",
            "tap",
            "classical",
            "calibrate",
        ),
        "make experiments": ("sweep", "curves", "lab", "demo", "attack", "bench"),
        "use the simulator alone": ("sabot", "replay"),
        "look after this machine": ("doctor", "clean"),
    }
)
VERBS = tuple(verb for verbs in HEADINGS.values() for verb in verbs)
# Verbs that print strings of runs and of hosts, and do not move the cursor.
PRINTING = (
    *HEADINGS["look at a network, or at a run"],
    *HEADINGS["change a running network"],
    "replay",
)


def described(words: Sequence[str] = ()) -> Parser:
    """Return a parser of the verb that is asked for, or of all, which takes longer to load."""
    parser = Parser(prog="qmn", description=__doc__, headings=HEADINGS)
    parser.add_argument("--version", action=ShowVersion, help="print name and version, and end")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    all_verbs = () if words[:1] == ["--version"] else VERBS
    for name in [name for name in VERBS if name in words[:1]] or all_verbs:
        import_module(f"qmn.verbs.{name}").add_parser(verbs)
    return parser


def needs_root(arguments: argparse.Namespace) -> bool:
    """Return whether this command needs root, as its verb says: always, or by its arguments."""
    needed = getattr(arguments, "needs_root", False)
    return bool(needed(arguments) if callable(needed) else needed)


def main() -> int:
    """Find the verb, run it, and return its exit status."""
    forget_no_width()
    status = with_outputs(run_verb)
    # All is done. Ending takes a moment, in which a signal would say otherwise.
    for number in Signals.NUMBERS:
        signal.signal(number, signal.SIG_IGN)
    return status


def run_verb() -> int:
    """Run the verb that the command line names, as root where it needs that."""
    if set(sys.argv[1:2]) & set(PRINTING):
        guard_standard_streams()
    gc.disable()  # what is loaded stays: to look through it takes a tenth of the time
    arguments = described(sys.argv[1:]).parse_args()
    gc.freeze()
    gc.enable()
    if needs_root(arguments):
        try:
            become_root(sys.argv[1:])
        except NoRoot as error:
            print(f"qmn: {error}", file=sys.stderr)
            return 1
    try:
        status: int = arguments.call(arguments)
    except OSError as error:
        if not (limit := limit_met(error)):
            raise
        print(f"qmn: {limit}", *getattr(error, "__notes__", ()), sep="\n", file=sys.stderr)
        return 1
    return status


if __name__ == "__main__":
    sys.exit(main())
