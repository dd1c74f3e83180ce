"""Lists of experiments, one a line."""

from collections.abc import Mapping

WIDTH = 24


def show(experiments: Mapping[str, str], indent: str = "") -> None:
    for name, text in experiments.items():
        print(f"{indent + name:<{WIDTH - 1}} {text}")
