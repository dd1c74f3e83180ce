"""Runs network tests that failed once more, each alone: a plug-in of pytest.

One that passes then is `late`: the summary names it with its reason, and the run is green. One that
was late in the run before, too, has failed; `.late` keeps the names.
"""

import json
import subprocess
import sys
from collections.abc import Sequence

import pytest
from _pytest.terminal import TerminalReporter
from limits import PROGRAM_S

KEPT = ".late"  # names of the last run, in the folder of the tests
MOST = 6  # more that fail are not late
FAILED = ("failed", "error")
FLAGS = ("-q", "-p", "no:cacheprovider", "-p", "garbage", "-p", "limits")


class Late:
    """Tests of a run that failed, and passed alone."""

    def __init__(self, config: pytest.Config, words: Sequence[str]) -> None:
        self._config, self._words = config, words
        self._kept = config.rootpath / KEPT
        self.reasons: dict[str, str] = {}  # by name of the test

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Repeat what failed; leave a run green if all of it passes, each for the first time."""
        reporter = self._config.pluginmanager.get_plugin("terminalreporter")
        if reporter is None or session.exitstatus != pytest.ExitCode.TESTS_FAILED:
            self._keep([])
            return
        failed = list(dict.fromkeys(name for name, _reason in failures(reporter)))
        before = json.loads(self._kept.read_text()) if self._kept.exists() else []
        passed = [name for name in failed if len(failed) <= MOST and self._passes(name)]
        self._keep(passed)
        self.reasons = {
            name: reason
            for name, reason in reversed(failures(reporter))  # the first is the cause
            if name in passed and name not in before
        }
        for kind in FAILED:
            reports = reporter.stats.pop(kind, [])
            for report in reports:
                late = report.nodeid in self.reasons
                reporter.stats.setdefault("late" if late else kind, []).append(report)
        if not any(reporter.stats.get(kind) for kind in FAILED):
            session.exitstatus = pytest.ExitCode.OK

    def pytest_terminal_summary(self, terminalreporter: TerminalReporter) -> None:
        """Name what was late, with its reason."""
        if self.reasons:
            terminalreporter.section("late: failed beside others, passed alone")
        for name, reason in self.reasons.items():
            terminalreporter.write_line(f"late {name}: {reason}")

    def _passes(self, name: str) -> bool:
        command = [*self._words, sys.executable, "-m", "pytest", *FLAGS, name]
        try:
            done = subprocess.run(
                command,
                cwd=self._config.rootpath,
                stdin=subprocess.DEVNULL,
                timeout=PROGRAM_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return False
        return done.returncode == 0

    def _keep(self, names: list[str]) -> None:
        if names:
            self._kept.write_text(json.dumps(names))
        else:
            self._kept.unlink(missing_ok=True)


def failures(reporter: TerminalReporter) -> list[tuple[str, str]]:
    """Return names of tests that failed, and why."""
    reports = [report for kind in FAILED for report in reporter.stats.get(kind, [])]
    return [(report.nodeid, reason(report)) for report in reports]


def reason(report: pytest.TestReport) -> str:
    """Return the message of what a test raised, or all that is known of a worker that died."""
    crash = getattr(report.longrepr, "reprcrash", None)
    return str(crash.message) if crash else report.longreprtext


def pytest_addoption(parser: pytest.Parser) -> None:
    """Take the words before the command that repeats a test."""
    parser.addoption("--alone", default="", help="what runs a test that is repeated alone")


def pytest_configure(config: pytest.Config) -> None:
    """Watch the run; a worker of pytest-xdist leaves that to its controller."""
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Late(config, config.getoption("--alone").split()))
