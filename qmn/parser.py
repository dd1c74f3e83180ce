"""The parser of the command line and of each verb on it."""

import argparse
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from importlib import import_module
from pkgutil import resolve_name
from textwrap import fill
from types import MappingProxyType, ModuleType
from typing import Any, NoReturn

from wire.parameters.checks import NEAR, check_choice, nearest
from wire.parameters.option import unit_of
from wire.parameters.quantity import quantity

REQUIRED = "the following arguments are required:"  # argparse's words
MANY = 20  # options; of more, --help shows these, and those of a small group of a job's own
FIRST = frozenset(
    {
        *("message", "file", "host", "count", "seconds", "state", "fidelity", "purification"),
        *(
            "service",
            "eve",
            "fec",
            "line",
            "graph",
            "probes",
            "traffic",
            "sessions",
            "key_lifetime",
        ),
        *("named", "preset", "length_km", "depolarizing", "seed", "captures", "live"),
        *("help", "help_all"),
    }
)
FEW = 6  # options of a group that is shown whole
OWN = frozenset({"the job", "the application"})  # groups of a job's own options
ALL = "--help-all"
NO_HEADINGS: Mapping[str, Collection[str]] = MappingProxyType({})
Kinds = Mapping[str, tuple[str, str]]  # by word: help, and MODULE:FUNCTION that describes a parser


def listed(title: str, what: Mapping[str, str]) -> str:
    width = argparse.HelpFormatter("")._width
    lead = " " * (4 + max(map(len, what)))
    lines = (
        fill(text, width, initial_indent=f"  {name}".ljust(len(lead)), subsequent_indent=lead)
        for name, text in what.items()
    )
    return "\n".join([f"{title}:", *lines, ""])


class Parser(argparse.ArgumentParser):
    """Takes options by their whole names alone: an abbreviation means another when options come.

    An error is one line, by the parser of the verb concerned, in the words of
    wire/parameters/checks.py.
    """

    def __init__(self, headings: Mapping[str, Collection[str]] = NO_HEADINGS, **value: Any) -> None:
        """Accept argparse's arguments; parsers of verbs use this class, too.

        Help has the verbs below under `headings`, which name them.
        """
        self._headings = headings
        self._put_off: Callable[[], None] | None = None
        # Takes words that are no options of this verb; it may raise ValueError.
        self.take_unknown: Callable[[argparse.Namespace, list[str]], None] | None = None
        super().__init__(**{"allow_abbrev": False} | value)

    def put_off(self, describe: Callable[[], None]) -> None:
        """Have the options described when they are needed first: of one job among twenty."""
        self._put_off = describe

    def complete(self) -> None:
        describe, self._put_off = self._put_off, None
        if describe is not None:
            self.usage = "%(prog)s [options]"  # which are some sixty
            describe()
        if self._has_many and ALL not in self._option_string_actions:
            self.add_argument(ALL, action=HelpAll, nargs=0, help="show all options, and exit")

    @property
    def _has_many(self) -> bool:
        return len(self._actions) > MANY

    def format_help(self) -> str:
        """Return the help: verbs under their headings, or those of many options that matter."""
        if not self._headings:
            return self._first_options() if self._has_many else super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for title, verbs in self.verbs_under_headings():
            formatter.start_section(title)
            formatter.add_arguments(verbs)
            formatter.end_section()
        formatter.start_section(self._optionals.title)
        formatter.add_arguments(self._optionals._group_actions)
        formatter.end_section()
        return formatter.format_help()

    def _first_options(self) -> str:
        formatter, left = self._get_formatter(), 0
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for group in self._action_groups:
            actions, whole = (
                group._group_actions,
                group.title in OWN and len(group._group_actions) <= FEW,
            )
            shown = [
                each for each in actions if whole or each.dest in FIRST or not each.option_strings
            ]
            left += len(actions) - len(shown)
            formatter.start_section(group.title)
            formatter.add_arguments(shown)
            formatter.end_section()
        formatter.add_text(f"{left} more options: {self.prog} {ALL}")
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def whole_help(self) -> str:
        return super().format_help()

    def verbs_under_headings(self) -> Iterator[tuple[str, list[argparse.Action]]]:
        assert self._subparsers is not None
        (below,) = self._subparsers._group_actions
        verbs = {each.dest: each for each in below._get_subactions()}  # type: ignore[attr-defined]
        for title, names in self._headings.items():
            yield title, [verbs[name] for name in names if name in verbs]

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; what is unknown to this verb is unknown to all."""
        self.complete()
        arguments, unknown = super().parse_known_args(args, namespace)
        if unknown and self.take_unknown is not None:
            try:
                self.take_unknown(arguments, unknown)
            except ValueError as error:
                self.error(str(error))
            return arguments, []
        if unknown:
            option = unknown[0].partition("=")[0]
            names = [name for name in self._option_string_actions if name.startswith("--")]
            near = nearest(option[2:], [name[2:] for name in names])
            remedy = f": {NEAR} --{near}?" if near and option.startswith("--") else ""
            if not option.startswith("-"):
                self.error(f"unexpected argument {option!r}")
            self.error(f"there is no {option}{remedy}")
        return arguments, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None:
            choices = [str(each) for each in action.choices]
            check_choice(name_of(action), str(value), choices, self._refused)

    def _get_value(self, action: argparse.Action, text: str) -> Any:
        try:
            if action.type is int or action.type is float:
                unit = unit_of(action.dest, str(action.metavar))
                return quantity(unit, text, action.type)
            return super()._get_value(action, text)
        except ValueError as error:
            raise self._refused(f"{name_of(action)} {error}") from error

    def _refused(self, text: str) -> argparse.ArgumentError:
        return argparse.ArgumentError(None, text)

    def error(self, message: str) -> NoReturn:
        """End with what is wrong and where the usage is: that of a run is longer than a screen."""
        message = message.removeprefix("argument ").replace(REQUIRED, "missing:")
        help_option = ALL if self._has_many else "--help"
        self.exit(2, f"{self.prog}: error: {message} (`{self.prog} {help_option}` lists all)\n")


class HelpAll(argparse.Action):
    """Shows all options of a parser that has many."""

    def __call__(self, parser: argparse.ArgumentParser, *_given: Any) -> None:
        assert isinstance(parser, Parser)
        parser._print_message(parser.whole_help(), sys.stdout)
        parser.exit()


def name_of(action: argparse.Action) -> str:
    if action.option_strings:
        return action.option_strings[-1]
    return str(action.metavar or action.dest)


def add_kinds(parser: Parser, metavar: str, kinds: Kinds, required: bool = False) -> None:
    """Add the kinds of a verb, as WHAT of `qmn set WHAT`: each is loaded when it is typed."""
    subparsers = parser.add_subparsers(metavar=metavar, required=required)
    for word, (text, function) in kinds.items():
        # Some show help of their own.
        kind = subparsers.add_parser(word, help=text, description=text, conflict_handler="resolve")
        kind.put_off(partial(_describe, kind, function))


def module_of(function: str) -> ModuleType:
    return import_module(function.partition(":")[0])


def _describe(parser: Parser, function: str) -> None:
    parser.usage = None  # that of argparse, which has every argument
    resolve_name(function)(parser)
