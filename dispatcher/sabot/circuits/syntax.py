"""From a text in OpenQASM 2.0 to its syntax tree, by the parser of the OpenQASM project.

That parser is for OpenQASM 3, which kept what users write in OpenQASM 2.0; what 2.0 does not
know is refused when the tree is read.
"""

import io
import re
from contextlib import redirect_stderr
from typing import NoReturn

from openqasm3 import ast
from openqasm3.parser import QASM3ParsingError, parse

from dispatcher.sabot.circuits.source import Source

HEADER = (
    'begin with the lines OPENQASM 2.0; and include "qelib1.inc"; (or, for a .chp program, say '
    "--format chp)"
)
PLACE = re.compile(r"L(\d+):C(\d+): (.*)", re.DOTALL)
LONGEST_TOKEN = 40  # in an error message
LONGEST_STATEMENT = 20_000
LONGEST_BRACKET = 250
DEEPEST = 30
LANDMARK = re.compile(r"[();{}]|\Z")
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


def parse_qasm(source: Source) -> ast.Program:
    """Return the syntax tree; raise CircuitError with line and column of what is wrong."""
    if not COMMENT.sub("", source.text).lstrip().startswith("OPENQASM"):
        source.fail(1, 1, f"this is not OpenQASM; {HEADER}")
    _check_lengths(source)
    try:
        # The parser also prints what it raises.
        with redirect_stderr(io.StringIO()):
            program = parse(source.text)
    except QASM3ParsingError as error:
        _fail(source, error)
    except RecursionError:
        source.fail(1, 1, "blocks are nested too deeply; write it in steps")
    except ValueError:
        source.fail(1, 1, "a number has thousands of digits; shorten it")
    if program.version != "2.0":
        problem = f"this is OpenQASM {program.version}; only 2.0 is read"
        source.fail(1, 1, f"{problem}: begin with OPENQASM 2.0;")
    return program


def _check_lengths(source: Source) -> None:
    """Refuse statements and brackets so long that the parser would take minutes for them."""
    text = COMMENT.sub(_blank, source.text)
    statement = bracket = depth = 0
    for place in LANDMARK.finditer(text):
        position = place.start()
        if depth and position - bracket > LONGEST_BRACKET:
            _fail_at(source, bracket, f"a bracket holds more than {LONGEST_BRACKET} characters")
        match place[0]:
            case "(":
                bracket = position if not depth else bracket
                depth += 1
                if depth > DEEPEST:
                    _fail_at(source, position, f"brackets are nested more than {DEEPEST} deep")
            case ")":
                depth = max(depth - 1, 0)
            case _:
                if position - statement > LONGEST_STATEMENT:
                    statement += len(text[statement:]) - len(text[statement:].lstrip())
                    problem = f"a statement has more than {LONGEST_STATEMENT:,} characters"
                    _fail_at(source, statement, problem)
                statement, depth = position + 1, 0


def _blank(comment: re.Match[str]) -> str:
    return "".join("\n" if letter == "\n" else " " for letter in comment[0])


def _fail_at(source: Source, position: int, problem: str) -> NoReturn:
    before = source.text[:position]
    line, column = before.count("\n") + 1, position - (before.rfind("\n") + 1) + 1
    source.fail(line, column, f"{problem}; write it in steps")


def _fail(source: Source, error: QASM3ParsingError) -> NoReturn:
    """Say where the parser stopped: it tells by its text, or by the token it could not take."""
    told = PLACE.fullmatch(str(error))
    if told:
        source.fail(int(told[1]), int(told[2]) + 1, _shortened(told[3]))
    cause = error.__cause__
    token = getattr(cause.args[0] if cause and cause.args else None, "offendingToken", None)
    if token is None:
        source.fail(1, 1, f"this is not OpenQASM 2.0; {HEADER}")
    what = "the end of the program" if token.type == -1 else repr(_shortened(token.text))
    problem = f"{what} is not expected here; is a ';' or a bracket missing before it?"
    source.fail(token.line, token.column + 1, problem)


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_TOKEN else text[:LONGEST_TOKEN] + "..."
