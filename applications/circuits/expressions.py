"""Angles of OpenQASM 2.0: numbers, pi, parameters, + - * / ^ and the usual functions.

A power binds more tightly than a sign, a product or a quotient, and to the right: -2^2 is -4,
2^3^2 is 512.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence

from applications.circuits.syntax import FUNCTIONS, Token, Tokens

LONGEST_BRACKET = 250  # characters: each application of a gate evaluates its expressions
DEEPEST = 30

Parameters = Mapping[str, float]
Expression = Callable[[Parameters], float]
Operation = Callable[[float, float], float]

FUNCTION = dict(
    zip(FUNCTIONS, (math.sin, math.cos, math.tan, math.exp, math.log, math.sqrt), strict=True)
)
SUMS: dict[str, Operation] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
}
PRODUCTS: dict[str, Operation] = {
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
}


class BadExpression(ValueError):
    """An expression that is not a finite number; the message says why."""


def evaluate(expression: Expression, parameters: Parameters) -> float:
    """Return the value of an expression; raise BadExpression if it has none."""
    try:
        value = expression(parameters)
    except (ArithmeticError, ValueError) as error:
        raise BadExpression(f"the angle cannot be computed: {error}") from error
    if not math.isfinite(value):
        raise BadExpression(f"the angle is {value}; it must be a finite number")
    return value


def read_arguments(tokens: Tokens, parameters: Collection[str]) -> tuple[Expression, ...]:
    start = tokens.next.position
    if not tokens.accept("(") or tokens.accept(")"):
        return ()
    reader = _Reader(tokens, parameters)
    arguments = [reader.read()]
    while tokens.accept(","):
        arguments.append(reader.read())
    if tokens.next.position - start - 1 > LONGEST_BRACKET:
        problem = f"a bracket holds more than {LONGEST_BRACKET} characters; write it in steps"
        tokens.fail(problem, start)
    tokens.expect(")")
    return tuple(arguments)


class _Reader:
    """Reads expressions by recursive descent."""

    def __init__(self, tokens: Tokens, parameters: Collection[str]) -> None:
        self._tokens, self._parameters = tokens, parameters
        self._depth = 1  # the bracket of the arguments

    def read(self) -> Expression:
        return self._chain(self._product, SUMS)

    def _product(self) -> Expression:
        return self._chain(self._signed, PRODUCTS)

    def _chain(
        self, operand: Callable[[], Expression], operations: Mapping[str, Operation]
    ) -> Expression:
        first = operand()
        rest: list[tuple[Operation, Expression]] = []
        while operation := operations.get(self._tokens.next.text):
            self._tokens.take()
            rest.append((operation, operand()))
        return _folded(first, rest) if rest else first

    def _signed(self) -> Expression:
        sign = 1
        while self._tokens.next.text in ("-", "+"):
            sign = -sign if self._tokens.take().text == "-" else sign
        power = self._power()
        return power if sign == 1 else lambda parameters: -power(parameters)

    def _power(self) -> Expression:
        base = self._atom()
        if self._tokens.next.text != "^":
            return base
        exponent = self._inside("^", self._signed)
        return lambda parameters: math.pow(base(parameters), exponent(parameters))

    def _atom(self) -> Expression:
        if self._tokens.next.text == "(":
            return self._bracket()
        if self._tokens.next.kind == "number":
            number = float(self._tokens.take().text)
            return lambda _parameters: number
        name = self._tokens.name()
        if self._tokens.next.text == "(":
            return self._call(name)
        if name.text in self._parameters:
            return lambda parameters: parameters[name.text]
        if name.text not in ("pi", "π"):
            names = ", ".join(["pi", *self._parameters])
            problem = f"unknown parameter {name.text!r}; known are {names}"
            self._tokens.fail(problem, name.position)
        return lambda _parameters: math.pi

    def _call(self, name: Token) -> Expression:
        function = FUNCTION.get(name.text)
        if function is None:
            problem = f"unknown function {name.text!r}; use one of {', '.join(FUNCTIONS)}"
            self._tokens.fail(problem, name.position)
        argument = self._bracket()
        return lambda parameters: function(argument(parameters))

    def _bracket(self) -> Expression:
        inner = self._inside("(", self.read)
        self._tokens.expect(")")
        return inner

    def _inside(self, opening: str, read: Callable[[], Expression]) -> Expression:
        """Read what comes behind an opening token; refuse to go deeper than the stack allows."""
        if self._depth == DEEPEST:
            problem = f"brackets and powers are nested more than {DEEPEST} deep; write it in steps"
            self._tokens.fail(problem)
        self._tokens.expect(opening)
        self._depth += 1
        expression = read()
        self._depth -= 1
        return expression


def _folded(first: Expression, rest: Sequence[tuple[Operation, Expression]]) -> Expression:
    def value(parameters: Parameters) -> float:
        result = first(parameters)
        for operation, operand in rest:
            result = operation(result, operand(parameters))
        return result

    return value
