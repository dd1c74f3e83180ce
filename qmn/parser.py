"""The parser of the command line and of each verb on it."""

import argparse
from collections.abc import Callable
from difflib import get_close_matches
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """Takes options by their whole names alone: an abbreviation means another when options come.

    What is wrong is one line, by the parser of the verb that it is said to.
    """

    def __init__(self, **given: Any) -> None:
        """Be argparse's own, but for that; so are the parsers of verbs."""
        self._put_off: Callable[[], None] | None = None
        super().__init__(**{"allow_abbrev": False} | given)

    def put_off(self, describe: Callable[[], None]) -> None:
        """Have the options described when they are needed first: of one job among twenty."""
        self._put_off = describe

    def complete(self) -> None:
        """Describe what was put off."""
        describe, self._put_off = self._put_off, None
        if describe is not None:
            describe()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; what is unknown to this verb is unknown to all."""
        self.complete()
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            option = unknown[0].partition("=")[0]
            known = [name for name in self._option_string_actions if name.startswith("--")]
            near = get_close_matches(option, known, 1) if option.startswith("--") else []
            remedy = f": did you mean {near[0]}?" if near else ""
            self.error(f"unrecognized arguments: {' '.join(unknown)}{remedy}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """End with what is wrong and where the usage is: that of a run is longer than a screen."""
        self.exit(2, f"{self.prog}: error: {message} (`{self.prog} --help` lists all)\n")
