"""Old words of the command line do what the new ones do, and name them."""

import shlex

import pytest

from qmn.old_words import translated


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("run chain --fec golay", "run sdc --topology chain --fec golay"),
        ("run ring --switches 4", "run sdc --topology ring,switches=4"),
        ("run tree --hosts=9 --to h5", "run sdc --topology tree,hosts=9 --to h5"),
        ("run sdc --both-ways", "run sdc --topology sdc,both_ways"),
        ("run swap --repeaters 3 --seed 2", "run swap --seed 2 --topology repeaters,repeaters=3"),
        ("run swap --stations", "run swap --topology repeaters,stations"),
        ("run load --switches 5", "run load --topology ring,switches=5"),
        ("run load --map garr --hosts-at a,b", "run load --topology map,map=garr,hosts_at=a,b"),
        ("run qkd --topology=chain --fibers 1", "run qkd --topology chain,fibers=1"),
        ("cli --live ring --switches 4", "cli --live ring,switches=4"),
        ("cli a.py:Net --switches 4", "cli a.py:Net,switches=4"),
        ("cli --map garr", "cli map,map=garr"),
        ("run qkd --no-capture --no-record", "run qkd --captures none --without record"),
        ("run qkd --no-events --no-report", "run qkd --without events --without report"),
        ("cli sdc --capture", "cli sdc --captures full"),
        ("netqasm app --map garr", "netqasm app --topology map,map=garr"),
    ],
)
def test_old_words_are_translated(old: str, new: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert shlex.join(translated(old.split())) == new
    assert capsys.readouterr().err == f"note: these words are old; the new ones: qmn {new}\n"


@pytest.mark.parametrize(
    "words",
    [
        "",
        "--version",
        "run",
        "run sdc --topology chain,switches=3 --to charlie",
        "cli ring,4",
        "sweep sdc --topology ring --map garr",
        "bench --hosts 4",
    ],
)
def test_words_of_today_stay(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert translated(words.split()) == words.split()
    assert capsys.readouterr().err == ""
