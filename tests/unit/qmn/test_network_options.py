"""Scripts say of a network what the command line says."""

import argparse
import re
from pathlib import Path
from typing import Any

import pytest

from hosts.middleware.session.errors import REMEDIES
from qmn.network.checks import check_address, check_module, check_network
from qmn.network.custom_topology import BadTopology
from qmn.network.options import NetworkOptions, settings
from qmn.network.time_scale import Pace
from qmn.options import BadInput, add_options, from_keywords, read
from qmn.scripting import start
from topologies.sdc import SdcTopo
from wire.metadata.vocabulary import Reason


def parse(*words: str) -> NetworkOptions:
    """Return what the command line says."""
    parser = argparse.ArgumentParser()
    add_options(parser, NetworkOptions)
    return read(NetworkOptions, parser.parse_args(words))


def test_what_is_not_said_is_the_same_on_the_command_line_and_in_scripts() -> None:
    assert parse() == from_keywords(NetworkOptions, {}) == NetworkOptions()


@pytest.mark.parametrize(
    ("words", "tls"), [({}, False), ({"tls": True}, True), ({"tls_from": "made"}, True)]
)
def test_certificates_of_ones_own_are_for_tls(words: dict[str, Any], tls: bool) -> None:
    options = from_keywords(NetworkOptions, words)
    network = settings(options, None, Pace())
    network.remove()
    assert network.settings.tls is tls


def test_a_keyword_means_the_same_as_its_option() -> None:
    words = [
        "--seed=7",
        "--length-km=2.5",
        "--fiber=phase_drift_time_s=1",
        "--fiber=filter_nm=2",
    ]
    words += ["--controller=os-ken", "--app=one", "--app=two", "--metrics"]
    assert from_keywords(
        NetworkOptions,
        {
            "seed": 7,
            "length_km": 2.5,
            "fiber": ["phase_drift_time_s=1", "filter_nm=2"],
            "controller": "os-ken",
            "apps": ["one", "two"],
            "metrics": True,
        },
    ) == parse(*words)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"seed": "many"}, "seed: 'many': choose a whole number"),
        ({"backend": "abacus"}, "backend 'abacus': choose one of chp, stim, dense"),
        ({"lenght_km": 2}, "there is no option lenght_km: did you mean length_km?"),
    ],
)
def test_keywords_that_cannot_be_are_refused(options: dict[str, object], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        from_keywords(NetworkOptions, options)


def test_a_seed_is_a_number_from_zero_on() -> None:
    with pytest.raises(BadInput, match=r"^--seed -1: choose 0 or more \(a whole number\)$"):
        check_network(parse("--seed=-1"))
    check_network(parse("--seed=0"))


def test_tags_have_a_new_folder_in_one_that_is_there(tmp_path: Path) -> None:
    check_network(parse(f"--tags={tmp_path}/tags"))
    with pytest.raises(BadInput, match="exists: name a new folder"):
        check_network(parse(f"--tags={tmp_path}"))
    with pytest.raises(BadInput, match=f"there is no folder {tmp_path}/no; make it before"):
        check_network(parse(f"--tags={tmp_path}/no/tags"))


def test_a_network_that_cannot_be_is_refused_before_it_starts() -> None:
    with pytest.raises(BadInput, match="unknown topology 'torus': choose one of sdc, chain"):
        start("torus").__enter__()
    with pytest.raises(BadInput, match="length_km is of the topologies of qmn"):
        start(SdcTopo, length_km=2).__enter__()
    with pytest.raises(BadInput, match="--history-depth -1: choose 0"):
        start("sdc", history_depth=-1).__enter__()
    with pytest.raises(BadTopology, match="map is of map, not of sdc"):
        start("sdc", map="abilene").__enter__()
    with pytest.raises(BadInput, match="--history-depth -1: choose 0"):
        start(map="abilene", history_depth=-1).__enter__()


@pytest.mark.parametrize("module", ["no.such.module", "ryu.app.no_such_app", ".relative", ""])
def test_an_app_that_is_not_there_is_refused_before_the_network_starts(module: str) -> None:
    with pytest.raises(BadInput, match="there is no such module"):
        check_module(module)


def test_an_app_that_is_there_is_not_refused() -> None:
    check_module("ryu.app.ofctl_rest")


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("8080", "write ADDRESS:PORT"),
        ("127.0.0.1:", "write ADDRESS:PORT"),
        ("127.0.0.1:70000", "write ADDRESS:PORT"),
        ("192.0.2.1:8080", "cannot listen there"),  # an address of documentation: nobody's
    ],
)
def test_an_address_that_nobody_can_listen_at_is_refused_too(address: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        check_address(address)
    check_address("127.0.0.1:18123")


def test_remedies_of_sessions_name_options_that_there_are() -> None:
    named = {
        reason: re.findall(r"--[a-z-]+", text) for reason, text in REMEDIES.items() if "--" in text
    }
    assert named == {
        Reason.NOT_ALLOWED: ["--policy"],
        Reason.LOSS_TOO_HIGH: ["--loss-budget-db"],
        Reason.SETUP_UNSEEN: ["--metadata-at-switch"],
        Reason.NO_CHAIN: ["--switch"],
    }
    assert parse("--switch=analysers=1").switch == ("analysers=1",)
    assert parse("--metadata-at-switch=observed").metadata_at_switch == "observed"
    assert parse("--policy=a", "--loss-budget-db=40").loss_budget_db == 40
