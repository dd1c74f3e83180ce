"""The kinds of a verb, as WHAT of `qmn set WHAT`: each is loaded when it is typed."""

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from pkgutil import resolve_name
from types import ModuleType

from qmn.parser import Parser

Kinds = Mapping[str, tuple[str, str]]  # by word: help, and MODULE:FUNCTION that describes a parser


def add_kinds(parser: Parser, metavar: str, kinds: Kinds, required: bool = False) -> None:
    words = parser.add_subparsers(metavar=metavar, required=required)
    for word, (text, function) in kinds.items():
        # Some show help of their own.
        kind = words.add_parser(word, help=text, description=text, conflict_handler="resolve")
        kind.put_off(partial(_describe, kind, function))


def module_of(function: str) -> ModuleType:
    return import_module(function.partition(":")[0])


def _describe(parser: Parser, function: str) -> None:
    parser.usage = None  # that of argparse, which has every argument
    resolve_name(function)(parser)
