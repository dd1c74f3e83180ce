"""The request of any job, as results and runners know it, which need not load what it is of."""

from dataclasses import Field
from typing import Any, ClassVar, Protocol

from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions


class Request(Protocol):
    """A frozen dataclass of all that a job can be asked (qmn.requests.kinds has them)."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def network(self) -> NetworkOptions:
        """In which network."""

    @property
    def run(self) -> RunOptions:
        """Options of every run."""
