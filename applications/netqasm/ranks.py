"""One rank of a NetQMPI program, which is one program for all ranks, on the host of that rank.

NetQMPI has all its ranks begin one after the other in one process, which notes what each will do;
the last one has them all simulated. Here each host does so, and executes its own rank's part alone.
"""

from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path


class NothingToDo(Exception):
    """The ranks of a program have not come to where NetQMPI has them simulated."""


def counts(file: Path, rank: int, size: int, shots: int) -> dict[str, int]:
    """Run a rank's part; return how often it has found which bits.

    Its own rank begins last, so that what it says of its results comes after these; what others
    say they say on their hosts. Raise NothingToDo if not every rank has made a circuit.
    """
    # They import netqasm.sdk.external, in whose place ours has to be first.
    from netqmpi.runtime.adapters.netqasm import (
        NetQASMCommunicator,
        NetQASMExecutorAdapter,
        NetQASMRunConfig,
    )

    by_rank: dict[int, dict[str, int]] = {}

    def take(_simulator: object) -> None:
        by_rank.update((each.rank, each.results) for each in NetQASMCommunicator.communicators)

    config = NetQASMRunConfig(shots=shots, post_function=take)
    executor = NetQASMExecutorAdapter(size, config)
    beginnings = executor.build_apps(str(file), size)
    beginning = beginnings.pop(rank)
    executor.run([*map(_silent, beginnings), beginning])
    if not by_rank:
        text = "has to make one circuit within its communicator (with env.comm: ...)"
        raise NothingToDo(f"{file}: each of {size} ranks {text}")
    return by_rank[rank]


def _silent(begin: Callable[[], None]) -> Callable[[], None]:
    def silently() -> None:
        with redirect_stdout(StringIO()):
            begin()

    return silently
