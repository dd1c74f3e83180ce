"""The result of a job as a table: a row with its options and its figures."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from qmn.requests.keeping import kept, kept_fields
from qmn.results.run_result import RunResult
from qmn.scripting.tables import SIMPLE, Row, Tabular, shown
from views.report import markup


@dataclass(kw_only=True)
class JobResult(RunResult, Tabular):
    """The content of result.json of a job.

    As a table one row: the job, its options that are not defaults, and the figures of who asks.
    """

    @property
    def stated_parameters(self) -> dict[str, Any]:
        """The parameters that are not at their defaults."""
        asked = self.parameters
        parts = {"options": type(getattr(asked, "options", None))}
        defaults = {name: each.default for name, each in kept_fields(type(asked), parts).items()}
        return {name: v for name, v in kept(asked).items() if v not in (defaults[name], [])}

    def rows(self) -> Sequence[Row]:
        """Return one row."""
        of_job = {"service": self.service, "delivered": self.delivered}
        setup = {"path_setup_ms": self.path_setup_ms.p50}
        values = {**of_job, **self.stated_parameters, **vars(self.asking), **setup}
        return [{name: value for name, value in values.items() if isinstance(value, SIMPLE)}]

    def _repr_html_(self) -> str:
        """Return what a notebook shows: a line for each value."""
        return markup.table(["", ""], [[name, shown(v)] for name, v in self.rows()[0].items()])
