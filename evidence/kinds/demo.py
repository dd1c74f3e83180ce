"""Effects of a whole network, measured and drawn beside theory.

Without a name: list the demos. Each is a sweep of emulated networks on a grid of its own;
`qmn lab sweep NAME --emulate` takes other grids.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

from evidence.kinds import listing, sweep
from evidence.networks.catalogue import DEMOS
from qmn.needs import Needs
from qmn.options import add_options, read
from qmn.parser import Parser
from qmn.requests.run_options import LiveOptions
from wire.parameters.option import option


@dataclass(frozen=True, kw_only=True)
class DemoOptions(LiveOptions):
    seed: int = option(1, "of all randomness (1)")
    out: Path = option(Path("demos"), "(demos)", metavar="FOLDER")


def names() -> dict[str, str]:
    return {name: demo.what for name, demo in DEMOS.items()}


def describe(parser: Parser) -> None:
    parser.description = __doc__
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("name", nargs="?", choices=[*DEMOS], metavar="NAME", help=", ".join(DEMOS))
    add_options(parser, DemoOptions)
    parser.set_defaults(call=call, needs=_needed)


def _needed(arguments: argparse.Namespace) -> Needs:
    return Needs.ROOT if arguments.name is not None else Needs.NOTHING


def call(arguments: argparse.Namespace) -> int:
    if arguments.name is None:
        listing.show(names())
        return 0
    return sweep.run(options_of(arguments))


def options_of(arguments: argparse.Namespace) -> sweep.SweepOptions:
    options = read(DemoOptions, arguments)
    return sweep.SweepOptions(
        what=DEMOS[arguments.name].experiment.name,
        axes=DEMOS[arguments.name].axes,
        emulate=True,
        seed=options.seed,
        out=options.out / arguments.name,
        live=options.live,
        live_for_all=options.live_for_all,
    )
