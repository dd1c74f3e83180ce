"""The one argument of our programs, and what they say where there is another."""

import sys
from pathlib import Path

import pytest

from programs.config_argument import config_path


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Let this process forget argparse, as one that was forked has never heard of it."""
    monkeypatch.delitem(sys.modules, "argparse")
    return monkeypatch


def test_file_is_known_without_a_parser(called: pytest.MonkeyPatch) -> None:
    called.setattr(sys, "argv", ["hosts", "--config", "/run/h4.json"])
    assert config_path("hosts", None) == Path("/run/h4.json")
    assert "argparse" not in sys.modules


@pytest.mark.parametrize(
    "words", [["--config=/run/h4.json"], ["--conf", "/run/h4.json"]], ids=["joined", "short"]
)
def test_other_ways_to_say_it_do_as_well(called: pytest.MonkeyPatch, words: list[str]) -> None:
    called.setattr(sys, "argv", ["hosts", *words])
    assert config_path("hosts", None) == Path("/run/h4.json")


@pytest.mark.parametrize("words", [[], ["--config"], ["--config", "a", "b"], ["/run/h4.json"]])
def test_anything_else_ends_with_the_usage(
    called: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    called.setattr(sys, "argv", ["hosts", *words])
    with pytest.raises(SystemExit) as ended:
        config_path("python -m hosts", "A stack.")
    assert ended.value.code == 2
    assert "usage: python -m hosts [-h] --config CONFIG" in capsys.readouterr().err
