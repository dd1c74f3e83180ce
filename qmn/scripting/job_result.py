"""The result of a job as a table: a row with its options and its figures."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from qmn.requests.recording import recorded, recorded_fields
from qmn.results.run_result import RunResult
from qmn.results.sentences import sentence
from qmn.scripting.tables import SIMPLE, Row, Tabular, drawn, file_of, shown
from views.report import markup
from views.report.markup import STYLE


@dataclass(kw_only=True)
class JobResult(RunResult, Tabular):
    """The content of result.json of a job.

    As a table one row: the job, its options that are not defaults, and the figures of who asks.
    """

    @property
    def stated_parameters(self) -> dict[str, Any]:
        """The parameters that are not at their defaults."""
        request = self.parameters
        parts = {"options": type(getattr(request, "options", None))}
        defaults = {
            name: each.default for name, each in recorded_fields(type(request), parts).items()
        }
        return {name: v for name, v in recorded(request).items() if v not in (defaults[name], [])}

    def rows(self) -> Sequence[Row]:
        """Return one row."""
        of_job = {"service": self.service, "delivered": self.delivered}
        setup = {"path_setup_ms": self.path_setup_ms.p50}
        values = {**of_job, **self.stated_parameters, **vars(self.asking), **setup}
        return [{name: value for name, value in values.items() if isinstance(value, SIMPLE)}]

    @property
    def pictures(self) -> list[str]:
        """The pictures of the job in its report, as HTML; those that need events are left out."""
        from views.report.figures import key_distribution_figures, pictures_of_states  # matplotlib
        from views.report.run_facts import RunFacts

        if self.network is None:
            return []
        run = RunFacts(Path(), self, self.network, events=[], setup_ms=[], sender=[])
        return [*key_distribution_figures(run), *pictures_of_states(run)]

    def svg(self) -> str:
        """Return the first of its pictures, as the text of a file; raise ValueError without any."""
        if not self.pictures:
            raise ValueError(f"{self.service} has no picture of figures alone: see `qmn report`")
        (svg, *_more) = re.findall(r"<svg.*?</svg>", self.pictures[0], re.DOTALL)
        return file_of(svg, STYLE.read_text())

    def _repr_html_(self) -> str:
        """Return what a notebook shows: its result in words, pictures, a line for each value."""
        values = [[name, shown(v)] for name, v in self.rows()[0].items()]
        pictures = drawn("".join(self.pictures), STYLE.read_text()) if self.pictures else ""
        return f"<p>{escape(sentence(self))}</p>{pictures}{markup.table(['', ''], values)}"
