"""The command line of our programs, `--config FILE`, read without argparse where it is well."""

import sys
from pathlib import Path


def config_path(program: str, description: str | None) -> Path:
    """Return the file that this program's command line names; end with a usage where it names none.

    A program that was forked off shares its memory until it writes there: what argparse would
    touch is a megabyte, of each host of a thousand.
    """
    match sys.argv[1:]:
        case ["--config", path]:
            return Path(path)
    import argparse

    parser = argparse.ArgumentParser(prog=program, description=description)
    parser.add_argument("--config", type=Path, required=True, help="JSON file of the runner")
    given: Path = parser.parse_args().config
    return given
