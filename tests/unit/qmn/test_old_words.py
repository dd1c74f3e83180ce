"""Old words of the command line do what the new ones do, and name them."""

import shlex
import subprocess
import sys

import pytest
from documentation import ROOT
from limits import SOON_S

from qmn.__main__ import VERBS as VERBS_OF_TODAY
from qmn.old_words import VERBS, translated

COMMANDS = [
    ("run chain --fec golay", "run sdc --topology chain --fec golay"),
    ("run ring --switches 4", "run sdc --topology ring,switches=4"),
    ("run tree --hosts=9 --to h5", "run sdc --topology tree,hosts=9 --to h5"),
    ("run sdc --both-ways", "run sdc --topology sdc,both_ways"),
    ("run swap --repeaters 3 --seed 2", "run swap --seed 2 --topology chain,switches=3"),
    ("run swap --topology repeaters,3", "run swap --topology chain,3"),
    ("run swap --topology=repeaters,repeaters=2", "run swap --topology=chain,switches=2"),
    ("run swap --topology repeaters,stations", "run swap --topology chain"),
    ("run swap --topology repeaters,3,stations", "run swap --topology chain,7"),
    ("run swap --repeaters 3 --stations", "run swap --topology chain,switches=7"),
    (
        "run distribute --node ion-trap --node charlie=station",
        "run distribute --node ion-trap --switch parts=station",
    ),
    ("run distribute --node=c=station", "run distribute --switch=parts=station"),
    ("lab sweep swap --repeaters 1:3", "lab sweep swap --switches 1:3"),
    ("sweep swap --repeaters=2", "lab sweep swap --switches=2"),
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
    ("netqasm app --no-looking", "netqasm app --no-state-inspection"),
    ("run sdc --time-scale 5", "run sdc --time paced=5"),
    ("cli sdc --time-scale=5 --tls", "cli sdc --time paced=5 --tls"),
    ("run sdc --seed 2 --time-scale auto", "run sdc --seed 2"),
    ("link alice q1 down", "set link alice q1 down"),
    ("fault q1 stuck 2 3", "set fault q1 stuck 2 3"),
    ("tap alice q1 0.5", "set tap alice q1 0.5"),
    ("classical alice q1 2", "set classical alice q1 2"),
    ("calibrate alice q1", "set calibrate alice q1"),
    ("policy reload", "set policy reload"),
    ("set alice fec golay", "set host alice fec golay"),
    ("run switch_swap --count 5", "run swap --count 5"),
    ("run switch_swap --topology=chain,2", "run swap --topology=chain,2"),
    ("share RUN COPY", "runs export RUN COPY"),
    ("demo", "lab demo"),
    ("demo flapping --seed 5", "lab demo flapping --seed 5"),
    ("curves --only mdi", "lab curves --only mdi"),
    ("lab curves --only=spied-pairs", "lab curves --only=eavesdropping"),
    ("lab sweep pairs-made --wanted 3", "lab sweep overhead --wanted 3"),
    ("sweep handed-over", "lab sweep fidelity-age"),
    ("sweep sdc --depolarizing 0:0.2:11", "lab sweep sdc --depolarizing 0:0.2:11"),
    ("sweep load --map garr", "lab sweep load --map garr"),
    ("attack all --defence off", "lab attack all --defence off"),
    ("bench --hosts 4", "lab bench --hosts 4"),
    ("lab paper decoy", "lab published paper decoy"),
    ("lab decoy", "lab published decoy"),
    ("lab --all --resume", "lab published --all --resume"),
]


def test_old_words_are_translated(capsys: pytest.CaptureFixture[str]) -> None:
    for old, new in COMMANDS:
        assert shlex.join(translated(old.split())) == new
        assert capsys.readouterr().err == f"note: these words are old; the new ones: qmn {new}\n"


def test_words_of_today_stay(capsys: pytest.CaptureFixture[str]) -> None:
    for words in [
        "",
        "--version",
        "run",
        "run sdc --topology chain,switches=3 --to charlie",
        "cli ring,4",
        "lab",
        "lab --help",
        "lab sweep sdc --topology ring --map garr",
        "lab bench --hosts 4",
        "lab published --all",
        "set",
        "set -h",
        "set host link fec golay",
        "set link alice q1 down",
        "set lnk alice q1 down",
        "lab demmo flapping",
        "runs export RUN COPY",
    ]:
        assert translated(words.split()) == words.split()
        assert capsys.readouterr().err == ""


def test_every_old_verb_is_tried_and_is_no_verb() -> None:
    """So the help, the completion and the count of verbs have none."""
    assert {old.split()[0] for old, _new in COMMANDS} >= {old[0] for old in VERBS}
    assert {old[0] for old in VERBS} & set(VERBS_OF_TODAY) == {"lab", "run", "set"}


def test_a_command_in_old_words_runs() -> None:
    command = [sys.executable, "-m", "qmn", "demo"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=ROOT, timeout=SOON_S
    )
    assert done.stdout.startswith("congestion ")
    assert done.stderr == "note: these words are old; the new ones: qmn lab demo\n"
