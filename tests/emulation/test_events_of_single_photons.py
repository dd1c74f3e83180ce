"""A block is one event with counts; its first photons have events of their own where asked."""

import json
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, in_runs, qmn_command, wait_until
from limits import SOON_S

from dispatcher.layer.history import WATCHED_PHOTONS

PAIRS = 1_200  # of a block: more than a spy sees one by one
BLOCKS = 1
WRITTEN_PHOTONS = 5
MESSAGE = ["--message", "x" * (BLOCKS * PAIRS // 4), "--frame-bytes", str(PAIRS // 4)]
# Slow enough that the spy is connected before bob's part begins.
# Four seconds of the wall.
PACE = ["--block-pairs", str(PAIRS), "--rate-hz", str(PAIRS // 4), "--time", "paced"]
SPY = [sys.executable, "-m", "qmn", "spy", "--json"]
Happening = tuple[object, ...]  # what happened where to which half of a block


def photons_of(events: Iterable[dict[str, Any]]) -> dict[Happening, list[int]]:
    """Return the photons shown of each event of a block, in order; 0 is the block's event."""
    reports: dict[Happening, list[int]] = defaultdict(list)
    for event in (event for event in events if "block" in event):
        names = ("node", "kind", "block", "half", "port")
        reports[tuple(event.get(name) for name in names)].append(event.get("photon", 0))
    return reports


def spied(*arguments: str) -> list[dict[str, Any]]:
    """Return the events of a run that was."""
    done = subprocess.run(
        [*SPY, *arguments], cwd=ROOT, capture_output=True, text=True, check=True, timeout=SOON_S
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.waits
def test_a_run_and_a_spy_tell_of_as_many_single_photons_as_were_asked_for(tmp_path: Path) -> None:
    command = [*qmn_command(tmp_path), *MESSAGE, *PACE, "--per-qubit", str(WRITTEN_PHOTONS)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True) as run:
        wait_until(lambda: in_runs("*/dispatcher.sock"), "a dispatcher")
        watch = [*SPY, "--per-qubit", "--node", "bob"]
        with subprocess.Popen(watch, cwd=ROOT, stdout=pipe, stderr=pipe, text=True) as spy:
            output, problem = run.communicate(timeout=SOON_S)
            lines, text = spy.communicate(timeout=SOON_S)
    assert run.returncode == 0, output + problem
    assert spy.returncode == 0, text
    assert text.endswith(" 0 dropped\n")

    live = photons_of(json.loads(line) for line in lines.splitlines())
    assert ("bob", "bell-measure", BLOCKS, 0, None) in live
    assert all(report == [*range(WATCHED_PHOTONS + 1)] for report in live.values())

    blocks, everything = (
        spied(str(tmp_path / "latest"), *words) for words in ([], ["--per-qubit"])
    )
    assert all(report == [0] for report in photons_of(blocks).values())
    assert all(event["photons"] == PAIRS for event in blocks if "block" in event)
    written = photons_of(everything)
    assert written.keys() == photons_of(blocks).keys()
    assert all(report == [*range(WRITTEN_PHOTONS + 1)] for report in written.values())
    kinds = [str(happening[1]) for happening in written if happening[2] == BLOCKS]
    assert sorted(kinds) == sorted(
        ["create", "apply", "bell-measure", *["send", "arrive", "receive"] * 3]
    )
    log = (tmp_path / "latest" / "quantum.log").read_text().splitlines()
    assert sum(" photon=" in line for line in log) == WRITTEN_PHOTONS * len(written)
    assert len(log) == len(everything)
    outcomes = [event["detail"] for event in everything if event["kind"] == "bell-measure"]
    assert set(outcomes[1 : 1 + WRITTEN_PHOTONS]) <= {"Phi+", "Psi+", "Phi-", "Psi-"}
