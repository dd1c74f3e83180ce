"""A field of a dataclass that a user can set: on the command line, in scripts, or in both.

@dataclass(frozen=True, kw_only=True)
class Settings:
    loss_budget_db: float = option(30.0, "of a light path (30)", metavar="DB", range=(0.0, 1_000.0))

A class whose options are shown together, under a title, has it as its GROUP.
"""

from dataclasses import field, fields
from typing import Any

from wire.parameters.checks import Refusal, check_choice, check_number

# Titles of groups that several classes have.
CONTROL = "copper and control"
SIMULATION = "time and simulation"
WRITTEN = "what is written and served"


def option(default: Any, help: str, **words: Any) -> Any:  # noqa: A002 (argparse's word)
    """Return a field that is an option.

    Its kind is that of the annotation: a number, text, a path, a bool, or a tuple of texts, for
    which it is said several times. Words are argparse's `metavar` and `choices`; `flag`, its name
    on the command line if that is another, "" if it has none there; `parse`, what reads its text;
    `const`, what it is if it is named without a value; `range`, the least and the most that a
    number may be; `instead_of`, a name that options share of which only one may be given; `group`,
    its title's if that is not its class's.
    """
    return field(default=default, metadata={"help": help, **words})


def check_options(options: Any, refusal: Refusal = ValueError) -> None:
    """Refuse a field of a dataclass that is outside its range or its choices."""
    for item in fields(options):
        value, metadata = getattr(options, item.name), item.metadata
        if value is None and item.default is None:
            continue
        if "choices" in metadata:
            check_choice(item.name, value, metadata["choices"], refusal)
        if "range" in metadata:
            least, most = metadata["range"]
            check_number(item.name, value, least, most, refusal)
