"""qmn sabot run FILE: run a quantum circuit, in OpenQASM 2.0 or .chp, on a simulation backend."""

import argparse
import json
import sys
from dataclasses import dataclass
from typing import Any, get_args

from rich.console import Console
from rich.table import Table

from applications.circuits.circuit import (
    MAX_OPERATIONS,
    MAX_SHOTS,
    Circuit,
    CircuitError,
    read_source,
)
from applications.circuits.interpreter import run_circuit
from applications.circuits.reading import Format, count, read_circuit
from dispatcher.recording.writer import MAX_QUBITS, MAX_SOURCE_BYTES
from dispatcher.sabot.backends import BACKENDS
from qmn.options import add_options, read
from wire.parameters.option import option

MOST_ROWS = 32
WIDEST = 100  # letters, of registers side by side
LIMITS = (
    f"Limits: {MAX_SOURCE_BYTES:,} bytes, {MAX_QUBITS:,} qubits, {MAX_OPERATIONS:,} operations, "
    f"{MAX_SHOTS:,} shots."
)


@dataclass(frozen=True)
class CircuitRun:
    file: str
    shots: int = option(1000, "how often (1000)", metavar="N")
    seed: int = option(1, "of all randomness (1)", metavar="N")
    backend: str = option("chp", "default: chp", choices=sorted(BACKENDS))
    format: Format | None = option(
        None, "default: by the file's name", choices=get_args(Format), parse=str
    )
    json: bool = option(False, "print everything, for programs")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("sabot")
    acts = parser.add_subparsers(metavar="ACT", required=True)
    run = acts.add_parser("run", help="run a circuit", description=__doc__, epilog=LIMITS)
    text = "program in OpenQASM 2.0, or in .chp if so named; - for standard input"
    run.add_argument("file", metavar="FILE", help=text)
    add_options(run, CircuitRun)
    run.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Run and print; turn what is wrong into one line and an exit status."""
    run = read(CircuitRun, arguments)
    try:
        circuit = read_circuit(read_source(run.file), run.format)
        batches = run_circuit(circuit, BACKENDS[run.backend], run.shots, run.seed)
        counts = count(circuit, batches)
    except CircuitError as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    if run.json:
        print(json.dumps(facts(circuit, counts, run), indent=2))
    else:
        show(circuit, counts, run)
    return 0


def facts(circuit: Circuit, counts: list[tuple[str, int]], run: CircuitRun) -> dict[str, Any]:
    """Return the result for programs; circuits are simulated exactly on every backend."""
    return {
        "file": run.file,
        "qubits": circuit.qubits,
        "registers": {register.name: register.size for register in circuit.registers},
        "shots": run.shots,
        "seed": run.seed,
        "backend": run.backend,
        "exact": True,
        "counts": dict(counts),
    }


def show(circuit: Circuit, counts: list[tuple[str, int]], run: CircuitRun) -> None:
    console = Console(highlight=False, soft_wrap=True)
    console.print(
        f"{circuit.qubits} qubits, {run.shots:,} shots, seed {run.seed}, backend "
        f"{run.backend}, exact: true"
    )
    if not circuit.bits:
        console.print("nothing is measured; add creg c[1]; and measure q[0] -> c[0];")
        return
    if sum(max(len(r.name), r.size) + 2 for r in circuit.registers) > WIDEST:
        for values, number in counts[:MOST_ROWS]:
            console.print(f"{number:,} shots, {100 * number / run.shots:.2f} %")
            for register, value in zip(circuit.registers, values.split(" "), strict=True):
                console.print(f"  {register.name} {value}")
    else:
        console.print(table(circuit, counts[:MOST_ROWS], run.shots))
    if len(counts) > MOST_ROWS:
        console.print(f"and {len(counts) - MOST_ROWS:,} values more; --json prints all")


def table(circuit: Circuit, counts: list[tuple[str, int]], shots: int) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for register in circuit.registers:
        table.add_column(register.name, no_wrap=True)
    for heading in ("shots", "%"):
        table.add_column(heading, justify="right")
    for values, number in counts:
        table.add_row(*values.split(" "), f"{number:,}", f"{100 * number / shots:.2f}")
    return table
