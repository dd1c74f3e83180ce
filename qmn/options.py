"""Options that are fields of dataclasses (wire.parameters.option), as a user gives them.

length_km: float = option(0.01, "of every fibre (0.01)", metavar="KM", range=(0.0, 2_000.0))

makes --length-km KM of a parser and length_km=… of a script.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin

from wire.parameters.checks import check_choice, check_number, remedy
from wire.parameters.option import Declaration, declared, unit_of
from wire.parameters.quantity import quantity

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Kind = TypeVar("Kind", bound="DataclassInstance")
NO_WORDS: Mapping[str, Declaration] = {}
Parts = Mapping[str, type[Any]]  # classes of parts, by their fields, if not those of the fields
NO_PARTS: Parts = {}
ARGPARSE = ("metavar", "choices", "const")  # words that are argparse's


class BadInput(Exception):
    """The request cannot be done; the text names value and remedy."""


def add_options(
    parser: argparse.ArgumentParser,
    kind: "type[DataclassInstance]",
    without: tuple[type[Any], ...] = (),
    words: Mapping[str, Declaration] = NO_WORDS,
    group: str = "",
) -> None:
    """Describe the options of a dataclass, but for those that its bases `without` have.

    `words` adds to or replaces declarations by name. Each option is in the GROUP of the class that
    declares it, or else in this one, or in none.
    """
    alternatives: dict[str, argparse._ActionsContainer] = {}
    left_out = {each.name for base in without for each in fields(base)}
    for each in _fields(kind):
        declaration: Declaration = {**declared(each), **words.get(each.name, {})}
        if "help" not in declaration or declaration.get("flag") == "" or each.name in left_out:
            continue
        target = titled(parser, declaration.get("group") or _group(kind, each.name) or group)
        if only_one := declaration.get("instead_of"):
            if only_one not in alternatives:
                alternatives[only_one] = target.add_mutually_exclusive_group()
            target = alternatives[only_one]
        action = target.add_argument(
            flag_of(each, declaration), dest=each.name, **_how(each, declaration)
        )
        # For the page of all options.
        action.range = declaration.get("range")  # type: ignore[attr-defined]


def titled(parser: argparse.ArgumentParser, title: str) -> argparse._ActionsContainer:
    """Return the group of a parser's options with this title, or the parser if there is none."""
    if not title:
        return parser
    groups = [group for group in parser._action_groups if group.title == title]
    return groups[0] if groups else parser.add_argument_group(title)


def read(
    kind: type[Kind], arguments: argparse.Namespace, parts: Parts = NO_PARTS, **known: Any
) -> Kind:
    """Return the options of a dataclass as the command line has them, or their defaults."""
    values = {name: value for name, value in vars(arguments).items() if value is not None}
    return CommandLineReader(values, known, parts).read(kind)


def from_keywords(
    kind: type[Kind], content: Mapping[str, Any], parts: Parts = NO_PARTS, **known: Any
) -> Kind:
    """Return the options that keywords name; raise BadInput for what the command line refuses."""
    reader = KeywordReader(dict(content), known, parts)
    options = reader.read(kind)
    for name in sorted(reader.given):
        raise BadInput(f"there is no option {name}: {remedy(name, reader.names)}")
    return options


@dataclass
class OptionReader:
    """Reads dataclasses of options, and the dataclasses that are parts of them.

    A value goes to the first field of its name, and is then no longer among those given.
    """

    given: dict[str, Any]  # by the names of `name_of`
    known: Mapping[str, Any]  # values of fields that nobody gives, by the fields' names
    parts: Parts
    names: list[str] = field(default_factory=list)  # that can be given

    def name_of(self, option: "Field[Any]") -> str | None:
        """Return the name by which a field is given; None: by none."""
        return option.name

    def value_of(self, option: "Field[Any]", value: Any) -> Any:
        return value

    def read(self, kind: type[Kind]) -> Kind:
        values = {}
        for each in fields(kind):
            part: Any = self.parts.get(each.name, each.type)
            if each.name in self.known:
                values[each.name] = self.known[each.name]
            elif isinstance(part, type) and is_dataclass(part):
                values[each.name] = self.read(part)
            elif name := self.name_of(each):
                self.names.append(name)
                if name in self.given:
                    values[each.name] = self.value_of(each, self.given.pop(name))
        return kind(**values)


class CommandLineReader(OptionReader):
    """Reads what argparse has made of words."""

    def value_of(self, option: "Field[Any]", value: Any) -> Any:
        """Return a value as its field has it: lists are tuples there, and some texts are paths."""
        if isinstance(value, list):
            return tuple(value)
        return Path(value) if kind_of(option.type) is Path else value


class KeywordReader(OptionReader):
    def name_of(self, option: "Field[Any]") -> str | None:
        return option.name if "help" in declared(option) else None

    def value_of(self, option: "Field[Any]", value: Any) -> Any:
        return _value(option, value)


def check_ranges(options: "DataclassInstance") -> None:
    """Raise BadInput for a number outside the range that is declared with it."""
    for each in fields(options):
        value = getattr(options, each.name)
        if (limits := declared(each).get("range")) and value is not None:
            check_range(each.name, value, *limits)


def check_range(name: str, value: float, least: float, most: float) -> None:
    """Raise BadInput unless the value of the option of this name is in its range."""
    check_number(f"--{name.replace('_', '-')}", value, least, most, BadInput)


def _fields(kind: "type[DataclassInstance]") -> list["Field[Any]"]:
    """Return the fields of a dataclass, its own before those of its bases."""
    names = [name for base in kind.__mro__ for name in vars(base).get("__annotations__", ())]
    return sorted(fields(kind), key=lambda each: names.index(each.name))


def _group(kind: "type[DataclassInstance]", name: str) -> str:
    declares = next(base for base in kind.__mro__ if name in vars(base).get("__annotations__", ()))
    return str(vars(declares).get("GROUP", ""))


def flag_of(option: "Field[Any]", declaration: Declaration) -> str:
    """Return the flag of an option on the command line; "" if it has none."""
    negated = "no-" if option.default is True else ""
    return declaration.get("flag", f"--{negated}{option.name.replace('_', '-')}")


def _how(option: "Field[Any]", declaration: Declaration) -> dict[str, Any]:
    help_text, kind = declaration["help"], kind_of(option.type)
    if kind is bool:
        action = "store_false" if option.default else "store_true"
        return {"action": action, "help": help_text}
    default = declaration.get("default", option.default)
    how: dict[str, Any] = {word: declaration.get(word) for word in ARGPARSE if word in declaration}
    if "const" in declaration:
        how["nargs"] = "?"
    if kind is tuple:
        many = {"action": "append", "default": []}
        return {**how, **many, "type": declaration.get("parse", str), "help": help_text}
    return {**how, "type": declaration.get("parse", kind), "default": default, "help": help_text}


def kind_of(hint: Any) -> Any:
    if get_origin(hint) is UnionType:
        hint = next(option for option in get_args(hint) if option is not type(None))
    return get_origin(hint) or hint


def _value(option: "Field[Any]", content: Any) -> Any:
    """Return the value of a keyword, read as its text would be on the command line."""
    kind, declaration = kind_of(option.type), declared(option)
    if content is None and option.default is None:
        return None
    if kind is tuple:
        values = content if isinstance(content, list | tuple) else (content,)
        return tuple(_parsed(option, str, value) for value in values)
    if kind is bool:
        if not isinstance(content, bool):
            raise BadInput(f"{option.name} {content!r}: choose True or False")
        return content
    value = _parsed(option, kind, content)
    if "choices" in declaration:
        check_choice(option.name, value, declaration["choices"], BadInput)
    return value


def _parsed(option: "Field[Any]", kind: Callable[[str], Any], value: Any) -> Any:
    parse = declared(option).get("parse", kind)
    try:
        if parse is int or parse is float:
            unit = unit_of(option.name, declared(option).get("metavar"))
            return quantity(unit, str(value), parse)
        return parse(str(value))
    except (ValueError, argparse.ArgumentTypeError) as error:
        raise BadInput(f"{option.name}: {error}") from error
