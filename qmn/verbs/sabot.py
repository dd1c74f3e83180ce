"""qmn sabot run FILE: run a quantum circuit, in OpenQASM 2.0 or .chp, on a simulation backend."""

import argparse
import json
import sys
from functools import partial
from typing import Any, get_args

from rich.console import Console
from rich.table import Table

from dispatcher.sabot.backends import BACKENDS
from dispatcher.sabot.circuits.circuit import (
    MAX_OPERATIONS,
    MAX_QUBITS,
    MAX_SHOTS,
    MAX_SOURCE_BYTES,
    Circuit,
    CircuitError,
)
from dispatcher.sabot.circuits.counting import count
from dispatcher.sabot.circuits.interpreter import run_circuit
from dispatcher.sabot.circuits.reading import Format, read_circuit
from dispatcher.sabot.circuits.source import read_source

MOST_ROWS = 32
WIDEST = 100  # letters, of registers side by side
LIMITS = (
    f"Limits: {MAX_SOURCE_BYTES:,} bytes, {MAX_QUBITS:,} qubits, {MAX_OPERATIONS:,} operations, "
    f"{MAX_SHOTS:,} shots."
)


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    text = "run quantum circuits on the simulator alone"
    parser = verbs.add_parser("sabot", help=text, description=text)
    acts = parser.add_subparsers(metavar="ACT", required=True)
    run = acts.add_parser("run", help="run a circuit", description=__doc__, epilog=LIMITS)
    add = partial(run.add_argument)
    add("file", help="program in OpenQASM 2.0, or in .chp if so named; - for standard input")
    add("--shots", type=int, default=1000, metavar="N", help="how often (1000)")
    add("--seed", type=int, default=1, metavar="S", help="of all randomness (1)")
    add("--backend", choices=sorted(BACKENDS), default="chp", help="default: chp")
    add("--format", choices=get_args(Format), help="default: by the file's name")
    add("--json", action="store_true", help="print everything, for programs")
    run.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Run and print; turn what is wrong into one line and an exit status."""
    try:
        circuit = read_circuit(read_source(arguments.file), arguments.format)
        backend = BACKENDS[arguments.backend]
        batches = run_circuit(circuit, backend, arguments.shots, arguments.seed)
        counts = count(circuit, batches)
    except CircuitError as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    if arguments.json:
        print(json.dumps(facts(circuit, counts, arguments), indent=2))
    else:
        show(circuit, counts, arguments)
    return 0


def facts(
    circuit: Circuit, counts: list[tuple[str, int]], arguments: argparse.Namespace
) -> dict[str, Any]:
    """Return the result for programs; circuits are simulated exactly on every backend."""
    return {
        "file": arguments.file,
        "qubits": circuit.qubits,
        "registers": {register.name: register.size for register in circuit.registers},
        "shots": arguments.shots,
        "seed": arguments.seed,
        "backend": arguments.backend,
        "exact": True,
        "counts": dict(counts),
    }


def show(circuit: Circuit, counts: list[tuple[str, int]], arguments: argparse.Namespace) -> None:
    """Print the counts as a table, the most frequent first."""
    console = Console(highlight=False, soft_wrap=True)
    console.print(
        f"{circuit.qubits} qubits, {arguments.shots:,} shots, seed {arguments.seed}, backend "
        f"{arguments.backend}, exact: true"
    )
    if not circuit.bits:
        console.print("nothing is measured; add creg c[1]; and measure q[0] -> c[0];")
        return
    if sum(max(len(r.name), r.size) + 2 for r in circuit.registers) > WIDEST:
        for values, number in counts[:MOST_ROWS]:
            console.print(f"{number:,} shots, {100 * number / arguments.shots:.2f} %")
            for register, value in zip(circuit.registers, values.split(" "), strict=True):
                console.print(f"  {register.name} {value}")
    else:
        console.print(table(circuit, counts[:MOST_ROWS], arguments.shots))
    if len(counts) > MOST_ROWS:
        console.print(f"and {len(counts) - MOST_ROWS:,} values more; --json prints all")


def table(circuit: Circuit, counts: list[tuple[str, int]], shots: int) -> Table:
    """Return counts with a column for each register."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for register in circuit.registers:
        table.add_column(register.name, no_wrap=True)
    for heading in ("shots", "%"):
        table.add_column(heading, justify="right")
    for values, number in counts:
        table.add_row(*values.split(" "), f"{number:,}", f"{100 * number / shots:.2f}")
    return table
