"""Tokens of OpenQASM 2.0 (arXiv:1707.03429), read from first to last."""

import re
from collections.abc import Iterator
from typing import NamedTuple, NoReturn

from applications.circuits.circuit import Source

LONGEST_TOKEN = 40  # in an error message
LONGEST_NUMBER = 4_000
KEYWORDS = ("OPENQASM", "include", "qreg", "creg", "gate", "opaque", "measure", "reset", "barrier")
FUNCTIONS = ("sin", "cos", "tan", "exp", "ln", "sqrt")
RESERVED = frozenset((*KEYWORDS, *FUNCTIONS, "if", "pi"))
TOKEN = re.compile(
    r"""(?P<space> \s+ | //[^\n]* | /\*.*?\*/ )
    | (?P<number> (?: [0-9]+\.?[0-9]* | \.[0-9]+ ) (?: [eE][-+]?[0-9]+ )? )
    | (?P<name> [^\W\d]\w* )
    | (?P<string> "[^"\n]*" )
    | (?P<mark> -> | == | . )""",
    re.VERBOSE | re.DOTALL,
)


class Token(NamedTuple):
    """A token: its kind (number, name, string, mark or end), text and place in the source."""

    kind: str
    text: str
    position: int


class Tokens:
    """The tokens of a source; `next` is the one that has not been taken yet."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._rest = _tokens(source.text)
        self.next = next(self._rest)

    def take(self) -> Token:
        token = self.next
        if token.kind == "number" and len(token.text) > LONGEST_NUMBER:
            self.fail("a number has thousands of digits; shorten it", token.position)
        if token.kind != "end":
            self.next = next(self._rest)
        return token

    def accept(self, text: str) -> bool:
        """Go past the next token if it is this one; return whether it is."""
        accepted = self.next.text == text
        if accepted:
            self.take()
        return accepted

    def expect(self, text: str) -> None:
        """Go past this token; raise CircuitError if it is not the next."""
        if not self.accept(text):
            self.unexpected()

    def name(self) -> Token:
        """Return the name that comes next; raise CircuitError if none does."""
        if self.next.kind != "name":
            self.unexpected()
        return self.take()

    def new_name(self) -> str:
        name = self.name()
        if name.text in RESERVED:
            problem = f"{name.text!r} is a word of OpenQASM 2.0; take another name"
            self.fail(problem, name.position)
        return name.text

    def integer(self) -> int | None:
        if self.next.kind != "number" or not self.next.text.isdecimal():
            return None
        return int(self.take().text)

    def unexpected(self) -> NoReturn:
        """Raise CircuitError for the next token."""
        text = self.next.text
        shortened = text if len(text) <= LONGEST_TOKEN else text[:LONGEST_TOKEN] + "..."
        what = repr(shortened) if text else "the end of the program"
        self.fail(f"{what} is not expected here; is a ';' or a bracket missing before it?")

    def fail(self, problem: str, position: int | None = None) -> NoReturn:
        """Raise CircuitError for a place in the source; None: for the next token."""
        before = self._source.text[: self.next.position if position is None else position]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        self._source.fail(line, column, problem)


def _tokens(text: str) -> Iterator[Token]:
    for match in TOKEN.finditer(text):
        kind = match.lastgroup
        if kind is not None and kind != "space":
            yield Token(kind, match[0], match.start())
    yield Token("end", "", len(text.rstrip()))
