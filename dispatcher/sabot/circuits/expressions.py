"""Angles as QASM writes them: numbers, pi, parameters, + - * / ^ and the usual functions."""

import math
from collections.abc import Callable, Mapping

from openqasm3 import ast

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
    "ln": math.log,
    "sqrt": math.sqrt,
}
OPERATIONS: dict[str, Callable[[float, float], float]] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
    "/": lambda left, right: left / right,
    "^": math.pow,
    "**": math.pow,
}


class BadExpression(ValueError):
    """An expression that is not a finite number; the message says why."""


def evaluate(expression: ast.Expression, parameters: Mapping[str, float]) -> float:
    """Return the value of an expression; raise BadExpression if it has none."""
    try:
        value = _value(expression, parameters)
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, BadExpression):
            raise
        raise BadExpression(f"the angle cannot be computed: {error}") from error
    if not math.isfinite(value):
        raise BadExpression(f"the angle is {value}; it must be a finite number")
    return value


def _value(expression: ast.Expression, parameters: Mapping[str, float]) -> float:
    match expression:
        case ast.IntegerLiteral(value=number) | ast.FloatLiteral(value=number):
            return float(number)
        case ast.Identifier(name=name):
            return _named(name, parameters)
        case ast.UnaryExpression(op=op, expression=inner) if op.name == "-":
            return -_value(inner, parameters)
        case ast.BinaryExpression(op=op, lhs=left, rhs=right) if op.name in OPERATIONS:
            return OPERATIONS[op.name](_value(left, parameters), _value(right, parameters))
        case ast.FunctionCall(name=name, arguments=[argument]) if name.name in FUNCTIONS:
            return FUNCTIONS[name.name](_value(argument, parameters))
    raise BadExpression(
        f"unknown kind of expression; use numbers, pi, + - * / ^ and {', '.join(FUNCTIONS)}"
    )


def _named(name: str, parameters: Mapping[str, float]) -> float:
    if name in parameters:
        return parameters[name]
    if name in ("pi", "π"):
        return math.pi
    known = ", ".join(["pi", *parameters])
    raise BadExpression(f"unknown parameter {name!r}; known are {known}")
