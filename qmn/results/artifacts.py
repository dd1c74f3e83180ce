"""The files of `qmn cli` and of scripts in their folder, beside logs and captures.

One timeline with its dissectors, and result.json: topology, parameters, seed, how it ended.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from qmn.network.options import NetworkOptions
from qmn.results.run_folder import PRIVATE, lasting
from qmn.results.run_result import NetworkResult
from qmn.results.timeline import TIMELINE, timeline_of_run
from topologies.networks.network import Interrupted
from topologies.system.processes.outputs import LostOutput
from topologies.system.processes.programs import NetworkError
from wire.controller_lines import EARLIER, RECORD
from wire.leaps import LEAPS
from wire.results.run_result import RESULT


@contextmanager
def artifacts_of(options: NetworkOptions, folder: Path | None) -> Iterator[NetworkResult]:
    """Yield the facts of a network, to be added to; at its end leave them and the timeline.

    Without a folder nothing is left.
    """
    facts = beginning(options)
    if folder is None:
        yield facts
        return
    folder.mkdir(mode=PRIVATE, parents=True, exist_ok=True)
    _forget_earlier(folder)
    with lasting(folder):
        try:
            yield facts
        except (NetworkError, Interrupted, LostOutput, OSError) as error:
            facts.error = str(error)
            raise
        finally:
            if folder.is_dir():
                facts.captures = [str(file) for file in sorted(folder.glob("*.pcap"))]
                facts.timeline = timeline_of_run(folder)
                facts.write(folder)


def _forget_earlier(folder: Path) -> None:
    """Remove what would be taken for this network's, if an earlier one had this folder.

    Logs and records are emptied when they are opened; see `Runtime.private_file`.
    """
    if any((folder / name).exists() for name in (RESULT, RECORD)):
        names = (RESULT, RECORD + EARLIER, LEAPS, TIMELINE)
        for left in (*(folder / name for name in names), *folder.glob("*.pcap")):
            left.unlink(missing_ok=True)


def beginning(options: NetworkOptions) -> NetworkResult:
    """Return what is known before the start."""
    return NetworkResult(
        topology=options.topology or None,  # None: a script's own
        mode=os.environ.get("QMN_MODE", "native"),
        controller=options.controller,
        seed=options.seed,
        parameters=options,
    )
