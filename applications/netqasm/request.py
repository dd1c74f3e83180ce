"""The request of a NetQASM application."""

from dataclasses import dataclass, field
from pathlib import Path

from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions
from wire.parameters.option import option, recorded_as


@dataclass(frozen=True, kw_only=True)
class NetqasmRequest:
    """An application, where its roles are, and what they are given."""

    # A folder, or the file of a NetQMPI program.
    path: Path = field(metadata=recorded_as("application"))
    ranks: int | None = option(
        None,
        "hosts that run a NetQMPI program, FILE.py",
        metavar="N",
        range=(2, 1_000),
        recorded=False,
    )
    place: tuple[str, ...] = option(
        (),
        "put a role on a host (repeatable; the host of its name, or the next that is free); with "
        "--machines also a host on a machine, as bob=m2",
        metavar="ROLE=HOST",
        recorded=False,
    )
    input: tuple[str, ...] = option(
        (),
        "what a program is given, as alice.x=1, beside what ROLE.yaml says (repeatable)",
        metavar="ROLE.NAME=VALUE",
    )
    rounds: int = option(
        1, "number of rounds, one after the other (1)", metavar="N", range=(1, 1_000_000)
    )
    state_inspection: bool = option(
        True, "programs may not look at states (get_qubit_state)", recorded=False
    )
    network: NetworkOptions
    run: RunOptions
