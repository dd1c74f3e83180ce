"""What `qmn run qkd` can be told, and what it refuses before anything starts."""

import argparse
from pathlib import Path

import pytest

from hosts.middleware.services.key_distribution.options import KeyOptions
from qmn.jobs.service import add_parsers, check_input
from qmn.network.options import BadInput


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_parsers(parser.add_subparsers())
    return parser.parse_args(words)


@pytest.mark.parametrize(
    ("words", "service"),
    [((), "bb84"), (("--protocol", "bb84"), "bb84"), (("--protocol", "bbm92"), "bbm92")],
)
def test_a_protocol_of_key_distribution_is_a_service(words: tuple[str, ...], service: str) -> None:
    arguments = parse("qkd", *words)
    assert arguments.service == service
    assert check_input(arguments) == KeyOptions(host="bob", port=9)


def test_options_reach_the_service() -> None:
    words = "--count 5000 --correction ldpc --max-qber 0.05 --test-fraction 0.2 --epsilon 1e-9"
    options = check_input(parse("qkd", *words.split(), "--bound", "asymptotic"))
    assert options == KeyOptions(
        host="bob",
        port=9,
        count=5000,
        correction="ldpc",
        max_qber=0.05,
        test_fraction=0.2,
        epsilon=1e-9,
        bound="asymptotic",
    )


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["qkd", "--max-qber", "0.3"], "at 0.11 no key is secret"),
        (["qkd", "--count", "2000000"], "count is 2000000: choose 1 to 1000000"),
        (["qkd", "--to", "alice"], "sender and receiver are both alice"),
        (["teleport", "--count", "0"], "count is 0"),
    ],
)
def test_what_cannot_be_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        check_input(parse(*words))


def test_keys_go_into_a_new_folder_only(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="name a new folder"):
        check_input(parse("qkd", "--keys", str(tmp_path)))
    check_input(parse("qkd", "--keys", str(tmp_path / "new")))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("verb", ["teleport", "distribute"])
def test_what_makes_no_keys_is_not_told_where_to_keep_them(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert parse(verb).keys is None
    with pytest.raises(SystemExit):
        parse(verb, "--keys", "keys")
    assert "unrecognized arguments: --keys" in capsys.readouterr().err
