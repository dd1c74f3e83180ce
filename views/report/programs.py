"""A NetQASM application: what its programs returned, and the table of their instructions."""

import json
from collections.abc import Iterable, Mapping
from html import escape

from views.report.markup import table
from wire.dispatcher_pb2 import Event
from wire.results.run_result import NetqasmJob

SUBROUTINE = "subroutine"
# Instructions on registers and memory alone: those of qubits and of the network are shown.
CLASSICAL = frozenset(
    ("set", "array", "store", "load", "lea", "undef", "add", "sub", "addm", "subm", "jmp", "beq")
) | frozenset(("bne", "bez", "bnz", "blt", "bge", "ret_reg", "ret_arr", "init", "qalloc", "qfree"))
MOST_ROUNDS, MOST_STEPS, MOST_LINES = 10, 40, 12


def outputs(job: NetqasmJob) -> str:
    """Return the table of what each role returned in each of the first rounds."""
    rows = [
        [str(number), *(json.dumps(each.get(role)) for role in job.roles)]
        for number, each in enumerate(job.outputs[:MOST_ROUNDS], 1)
    ]
    if not rows:
        return ""
    heads = ["round", *(f"{role} on {host}" for role, host in job.roles.items())]
    left = len(job.outputs) - len(rows)
    more = f"<p>{left:,} more rounds are in result.json.</p>" if left else ""
    return f"<section><h2>What the programs returned</h2>{table(heads, rows)}{more}</section>"


def instruction_table(events: Iterable[Event], roles: Mapping[str, str]) -> str:
    """Return the table of instructions: a row for each subroutine, a column for each host."""
    subroutines = [event for event in events if event.kind == SUBROUTINE]
    hosts = list(dict.fromkeys(roles.values()))
    rows: list[str] = []
    for event in subroutines:
        lines = instructions(event.detail)
        if lines and event.node in hosts and len(rows) < MOST_STEPS:
            since = f"{(event.time_ns - subroutines[0].time_ns) / 1e3:,.3f}"
            cells = (
                "<br>".join(map(escape, lines)) if host == event.node else "" for host in hosts
            )
            rows.append("".join(f"<td>{cell}</td>" for cell in (since, *cells)))
    if not rows:
        return ""
    head = "".join(f"<th>{escape(name)}</th>" for name in ("time (µs)", *hosts))
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    text = "Instructions on qubits and on the network, by the subroutine that has them; those on "
    text += "registers and memory are left out."
    made = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    made = f'<p>{text}</p><div class="scroll">{made}</div>'
    return f"<section><h2>The programs, instruction by instruction</h2>{made}</section>"


def instructions(subroutine: str) -> list[str]:
    """Return those of qubits and of the network, the first MOST_LINES of them."""
    parts = [word.strip() for word in subroutine.split(";")]
    quantum = [part for part in parts if part and part.split()[0] not in CLASSICAL]
    more = [f"and {len(quantum) - MOST_LINES} more"] if len(quantum) > MOST_LINES else []
    return quantum[:MOST_LINES] + more
