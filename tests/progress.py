"""Says now and then how far the tests are, and at once which failed: a plug-in of pytest.

At the end it adds up the processor seconds of these tests and of what came before (setup/part).
"""

import os
import resource
import time
from collections.abc import Sequence

import pytest
from _pytest.terminal import TerminalReporter

EVERY_S = 15.0


def left(done: int, total: int, elapsed_s: float) -> str:
    """Return in words how long the rest takes, if it goes on as it did until now."""
    rest_s = elapsed_s / done * (total - done)
    return f"{rest_s / 60:.0f} min" if rest_s > 90 else f"{rest_s:.0f} s"


def processor(parts: str, here_s: float) -> str:
    """Return in words the processor seconds of these tests, and of parts before: NAME=SECONDS."""
    before = [part.split("=") for part in parts.split()]
    total_s = here_s + sum(float(seconds) for _name, seconds in before)
    words = [f"{here_s:.0f} s here", *(f"{name} {seconds} s" for name, seconds in before)]
    return f"processor: {', '.join(words)}; {total_s:.0f} s in all"


class Progress:
    """Counts tests that are done, wherever they run."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._total = self._done = 0
        self._began_s = self._told_s = time.monotonic()

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Take the number of tests that this process runs."""
        self._begin(len(session.items))

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: Sequence[str]) -> None:
        """Take the number of tests that the workers share, or that each has of its own."""
        own = self._total if self._config.getoption("dist") == "each" else 0
        self._begin(own + len(ids))

    def _begin(self, total: int) -> None:
        self._total = max(self._total, total)
        self._began_s = self._told_s = time.monotonic()

    def pytest_sessionstart(self, session: pytest.Session) -> None:
        """Keep the session, whose number of tests pytest's percentages are of."""
        self._session = session

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Name a test that failed: its reason comes at the end, which a stopped run lacks."""
        self._session.testscollected = self._total
        if report.failed:
            self._tell(f" failed: {report.nodeid}")

    def pytest_runtest_logfinish(self) -> None:
        """Count one, and tell if it is time."""
        self._done += 1
        now_s = time.monotonic()
        if now_s - self._told_s < EVERY_S:
            return
        self._told_s = now_s
        if self._done < self._total:
            rest = left(self._done, self._total, now_s - self._began_s)
            self._tell(f" {self._done:,} of {self._total:,} tests, about {rest} left")

    def pytest_terminal_summary(self, terminalreporter: TerminalReporter) -> None:
        """Tell the processor seconds; workers have ended, and what they started."""
        kinds = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
        used = [resource.getrusage(kind) for kind in kinds]
        here_s = sum(each.ru_utime + each.ru_stime for each in used)
        terminalreporter.write_line(processor(os.environ.get("PARTS", ""), here_s))

    def _tell(self, line: str) -> None:
        reporter = self._config.pluginmanager.get_plugin("terminalreporter")
        if reporter is not None:
            reporter.write_line(line)


def pytest_configure(config: pytest.Config) -> None:
    """Watch the run; a worker of pytest-xdist leaves that to who started it."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(config))
