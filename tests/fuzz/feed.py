"""Feeds spoiled messages to every decoder, and spoiled requests to the dispatcher and to Sabot.

python tests/fuzz/feed.py --inputs 10000000 --seed 1      (`make fuzz INPUTS=10000000 SEED=1`)

No input may raise anything but the refusal that the decoder names; what is taken must mean the
same when it is written and read again; and a refused request must change nothing. A fault names
the input, as hexadecimal, and is status 1.
"""

import argparse
import multiprocessing
import sys
import time
from collections import Counter
from pathlib import Path
from random import Random
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
SCENES = (
    f"tests/unit/{each}" for each in ("wire", "applications", "controller_apps", "qswitch_agent")
)
sys.path[:0] = [str(ROOT / folder) for folder in ("", "tests/fuzz", *SCENES)]

from decoders import TARGETS  # noqa: E402
from requests_to_dispatcher import Dispatcher  # noqa: E402
from requests_to_sabot import SabotServer  # noqa: E402

PIECE = 2_000  # inputs, between looks at the time
SERVERS: dict[str, type[Dispatcher | SabotServer]] = {
    "dispatcher": Dispatcher,
    "Sabot": SabotServer,
}
SHARE_OF_SERVERS = 50  # the share of inputs that are valid requests


class Piece(NamedTuple):
    """A number of inputs for one decoder, which follow from the seed alone."""

    target: str
    seed: int
    inputs: int


class Result(NamedTuple):
    """The outcome of a piece."""

    target: str
    inputs: int
    taken: int
    fault: str = ""


def run(piece: Piece) -> Result:
    """Feed one piece; stop at the first fault."""
    random = Random(f"{piece.target} {piece.seed}")
    if piece.target in SERVERS:
        taken, fault = SERVERS[piece.target](random).feed(piece.inputs)
        return Result(*piece[::2], taken, fault)
    target, taken = TARGETS[piece.target], 0
    for number in range(piece.inputs):
        data = target.spoil(random.choice(target.samples), random)
        try:
            taken += target.take(data)
        except Exception as error:  # noqa: BLE001 (this is what is looked for)
            words = f"{type(error).__name__}: {error}; input {data.hex()}"
            return Result(piece.target, number + 1, taken, words)
    return Result(piece.target, piece.inputs, taken)


def pieces(inputs: int, seed: int, names: list[str]) -> list[Piece]:
    """Return what is to be fed: each decoder as often as every other."""
    shares = {name: inputs // len(names) for name in names}
    servers = [name for name in names if name in SERVERS]
    if len(names) > len(servers):
        few = inputs // len(names) // SHARE_OF_SERVERS
        spared = sum(shares[name] - few for name in servers)
        shares = {
            name: share + spared // (len(names) - len(servers)) for name, share in shares.items()
        }
        shares |= dict.fromkeys(servers, few)
    return [
        Piece(name, seed * 1_000_000 + start // PIECE, min(PIECE, share - start))
        for name, share in shares.items()
        for start in range(0, share, PIECE)
    ]


def main() -> int:
    """Read the arguments, feed, and print what became of it."""
    parser = argparse.ArgumentParser(prog="python tests/fuzz/feed.py", description=__doc__)
    parser.add_argument("--inputs", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=[*TARGETS, *SERVERS], action="append")
    arguments = parser.parse_args()
    work = pieces(arguments.inputs, arguments.seed, arguments.only or [*TARGETS, *SERVERS])
    fed: Counter[str] = Counter()
    taken: Counter[str] = Counter()
    faults: dict[str, str] = {}
    began = time.monotonic()
    with multiprocessing.Pool() as pool:
        for result in pool.imap_unordered(run, work):
            fed[result.target] += result.inputs
            taken[result.target] += result.taken
            if result.fault and result.target not in faults:
                faults[result.target] = result.fault
                print(f"fuzz: {result.target}: {result.fault}", flush=True)
    for name, count in fed.items():
        print(f"{name:24} {count:12,} inputs {taken[name] / count:8.1%} taken")
    total, seconds = sum(fed.values()), time.monotonic() - began
    print(f"{total:,} inputs in {seconds:,.0f} s, seed {arguments.seed}: {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
