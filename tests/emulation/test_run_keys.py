"""qmn run keys: stores stay filled over cuts and eavesdroppers, and say what happened when."""

import json
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from conftest import wait_until
from fabric_scene import running
from key_scene import HIGH, LOW, Keys
from loaded import run_qmn
from test_results_fit_schema import require_schema

from applications.keys.config import KeyLink
from applications.keys.key_managers import KeyService, start_key_managers
from applications.qkd.key_store import KeyStore
from applications.qkd.keyring import CAPACITY
from qmn.jobs.transfer import Lines
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.certificates import CertificateAuthority


def run_keys(runs: Path, *words: str) -> tuple[subprocess.CompletedProcess[str], dict[str, Any]]:
    """Keep keys for a while; return the process, and the result."""
    done = run_qmn("run", "keys", *words, "--without", "report", "--runs", str(runs))
    return done, json.loads((runs / "latest" / "result.json").read_text())


@pytest.mark.waits
def test_an_eavesdropper_comes_and_leaves_on_one_time_line(tmp_path: Path) -> None:
    # The marks are never reached, so that sessions follow one another.
    marks = ("--low-mark", "4000", "--high-mark", "4000", "--session-bits", "12000")
    eve = ("--eve", "1", "--at", "2", "--until", "4")
    done, result = run_keys(
        tmp_path, "--seconds", "10", "--withhold", "--without", "events", *marks, *eve
    )
    assert done.returncode == 0, done.stdout + done.stderr
    moments = result["job"]["time_series"]
    at = {each["event"]: each["at"] for each in moments if each["event"].startswith("eve")}
    opened = [each for each in moments if each.get("opened")]
    for moment in opened:  # a quarter is wrong when she measures everything, nothing else is
        if moment["event"] == "alarm":
            assert moment["withheld"]
            assert at["eve_comes"] < moment["at"] < at["eve_leaves"] + 2.0
            assert abs(moment["qber"] - 0.25) < 5 * (0.25 * 0.75 / 1200) ** 0.5
        elif moment["event"] == "session":
            assert (moment["qber"], moment["withheld"]) == (0, False)
    kinds = [each["event"] for each in opened]
    assert "alarm" in kinds
    last = max(each["at"] for each in opened if each["event"] == "session")
    assert last > at["eve_leaves"]
    assert [each["at"] for each in moments] == sorted(each["at"] for each in moments)
    assert result["job"]["asking"]["keys"] == sum(each["keys"] for each in opened)
    require_schema(tmp_path / "latest")
    policy = tomllib.loads((tmp_path / "latest" / "policy.toml").read_text())
    assert "tap" not in policy


def test_a_relay_that_nobody_trusts_fills_the_stores_of_both_ends_alike(tmp_path: Path) -> None:
    link = KeyLink("", True, low=4, high=8, protocol="mdi", options={"count": 12_000})
    with running(SdcTopo, tmp_path) as network:
        start_key_managers(network, KeyService([("alice", "bob")], link))
        folders = {name: Path(network.runtime.key_folder(name)) for name in ("alice", "bob")}
        mine = KeyStore(folders["alice"] / "bob", CAPACITY)
        theirs = KeyStore(folders["bob"] / "alice", CAPACITY)
        for store in (mine, theirs):
            wait_until(lambda: min(store.mine, store.theirs) >= 8, "keys")  # noqa: B023
        out = mine.take_oldest(4)
        assert theirs.take_all([each.key_id for each in out]) == [each.key for each in out]
        relay = Path(network.runtime.key_folder("charlie"))
        assert not [path for path in relay.rglob("*") if path.is_file()]


def test_several_pairs_keep_keys_and_sessions_come_back_after_a_cut(keys_network: Network) -> None:
    runtime = keys_network.runtime
    text = Lines(Keys(keys_network).manager("alice"))
    for one, other in (("alice", "charlie"), ("charlie", "bob")):
        mine = KeyStore(Path(runtime.key_folder(one)) / other, CAPACITY)
        theirs = KeyStore(Path(runtime.key_folder(other)) / one, CAPACITY)
        for count in ("mine", "theirs"):
            wait_until(lambda: getattr(mine, count) >= LOW, f"{one}, {other}: {count}")  # noqa: B023
        assert (mine.mine, mine.theirs) == (theirs.theirs, theirs.mine)
    keys_network.net.configLinkStatus("alice", "q1", "down")
    store = KeyStore(Path(runtime.key_folder("alice")) / "charlie", CAPACITY)
    store.take_oldest(store.mine)

    def failed() -> bool:
        return any("cut" in each.get("text", "") for each in text.new())

    wait_until(failed, "a session fails for the cut")
    assert store.mine == 0
    keys_network.net.configLinkStatus("alice", "q1", "up")
    wait_until(lambda: store.mine >= HIGH, "alice has keys again")


@pytest.mark.nightly
def test_hosts_of_the_command_line_find_their_keys_with_certificates_that_were_given(
    tmp_path: Path,
) -> None:
    folder, hosts = tmp_path / "certificates", ("alice", "bob", "charlie")
    authority = CertificateAuthority(folder, "somebody else's")
    for number, host in enumerate(hosts, start=1):
        authority.issue(f"kme-{host}", {host: f"10.0.0.{number}"})
        authority.issue(f"sae-{host}")
    authority.issue("web")
    curl = "curl -sS --cert $SAE_CERT --key $SAE_KEY --cacert $KME_CA $KME/api/v1/keys"
    words = ["--key-pair", "alice:bob", "--sae", "web=bob", "--certificates", str(folder)]
    asked = f"alice {curl}/web/status\nbob {curl}/sae-alice/status\n"
    done = run_qmn("cli", "sdc", *words, "--runs", str(tmp_path / "runs"), commands=asked)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "keys of alice: https://10.0.0.1:8443" in done.stdout
    lines = [json.loads(each) for each in re.findall(r"\{.*?\}", done.stdout)]
    names = [(each["master_SAE_ID"], each["slave_SAE_ID"], each["key_size"]) for each in lines]
    assert names == [("sae-alice", "web", 256), ("sae-bob", "sae-alice", 256)]
