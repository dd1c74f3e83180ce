"""A field of a dataclass that a user can set: on the command line, in scripts, or in both.

@dataclass(frozen=True, kw_only=True)
class Settings:
    loss_budget_db: float = option(30.0, "of a light path (30)", metavar="DB", range=(0.0, 1_000.0))

A class whose options are shown together, under a title, has it as its GROUP.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import Field, field, fields
from typing import Any, TypedDict, TypeVar, Unpack, cast

from wire.parameters.checks import Refusal, check_choice, check_number

T = TypeVar("T")

# Titles of groups that several classes have.
CONTROL = "copper and control"
SIMULATION = "time and simulation"
WRITTEN = "what is written and served"


class Words(TypedDict, total=False):
    """How an option is spelled, and what it may be."""

    metavar: str
    choices: Collection[str]
    flag: str  # on the command line, if not the field's name; "": none there
    parse: Callable[[str], Any]  # of its text
    const: int  # if it is named without a value
    range: tuple[float, float]  # least and most of a number
    instead_of: str  # a name that options share of which only one may be given
    group: str  # title, if not the GROUP of the class
    of: str  # a field without which this one means nothing
    recorded: bool  # not, if result.json has it elsewhere, or if no figure depends on it


class Declaration(Words, total=False):
    """The declarations of a field, or of a parser in its place."""

    help: str  # of options alone
    default: str  # of parsers
    recorded_as: str  # of fields that are no options


def option(default: T, help: str, **words: Unpack[Words]) -> T:  # noqa: A002 (argparse's word)
    """Return a field that is an option.

    Its kind is that of the annotation: a number, text, a path, a bool, or a tuple of texts, for
    which it is given several times.
    """
    return field(default=default, metadata={"help": help, **words})


def recorded_as(name: str) -> Mapping[str, str]:
    """Return the metadata of a field that is no option, but is in result.json by this name."""
    return {"recorded_as": name}


def declared(item: "Field[Any]") -> Declaration:
    return cast("Declaration", item.metadata)


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


UNITS = (  # longer endings first
    ("_ps_per_sqrt_km", "ps/sqrt km"),
    ("_ps_per_nm_km", "ps/(nm km)"),
    ("_rad_per_sqrt_km", "rad/sqrt km"),
    ("_rad_per_s", "rad/s"),
    ("_k_per_sqrt_s", "K/sqrt s"),
    ("_k_per_s", "K/s"),
    ("_ppm_per_k", "ppm/K"),
    ("_per_km_nm", "1/(km nm)"),
    ("_per_s", "1/s"),
    ("_mw", "mW"),
    ("_mbps", "Mbit/s"),
    ("_nm", "nm"),
    ("_db_per_km", "dB/km"),
    ("_km", "km"),
    ("_db", "dB"),
    ("_hz", "Hz"),
    ("_ps", "ps"),
    ("_rad", "rad"),
    ("_ms", "ms"),
    ("_us", "us"),
    ("_ns", "ns"),
    ("_s", "s"),
    ("_dbm", "dBm"),
    ("_mhz", "MHz"),
    ("_pm", "pm"),
    ("_c", "°C"),
    ("_gib", "GiB"),
    ("_bytes", "bytes"),
)
UNITS_OF_METAVARS = {"S": "s"}  # of names without a unit, as seconds


def unit_of(name: str, metavar: str | None = None) -> str:
    """Return the unit that an option's name ends in, or that of its metavar; "" for none."""
    named = (unit for ending, unit in UNITS if name.endswith(ending))
    return next(named, UNITS_OF_METAVARS.get(metavar or "", ""))
