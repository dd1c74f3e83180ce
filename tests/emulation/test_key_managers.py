"""Keys by ETSI GS QKD 014 from hosts that made them of light, to clients that nobody here wrote."""

import base64
import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import nothing_left, wait_until
from fabric_scene import running
from key_scene import CURL, HIGH, LOW, Keys
from limits import SOON_S
from scapy.utils import rdpcap

from applications.keys.config import KEY_DELIVERY_PORT
from applications.keys.key_managers import KeyService, start_key_managers
from qmn.results.timeline import merge
from topologies.networks.network import Network
from topologies.sdc import SdcTopo
from topologies.system.certificates import CertificateFiles
from topologies.system.confinement.confinement import children
from topologies.system.processes import shells
from topologies.system.processes.programs import NetworkError

PROGRAMS = Path(sys.executable).parent
# A program of the client library's user; the paths are those that the host's shell knows.
CLIENT = """
import os, sys
from etsi_qkd_014_client import QKD014Client
kme, call, sae, *ids = sys.argv[1:]
client = QKD014Client(kme, os.environ["SAE_CERT"], os.environ["SAE_KEY"], os.environ["KME_CA"])
if call == "dec":
    code, found = client.get_key_with_key_IDs(sae, ids)
else:
    code, found = client.get_key(sae, 2, 512)
print(code, *(f"{key.key_id} {key.key}" for key in found.keys))
"""


def test_key_managers_wait_for_no_stopped_shell_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shells, "COMMAND_TIMEOUT_S", 0.5)
    with nothing_left(), running(SdcTopo, tmp_path) as network:
        (shell,) = children(network.host("bob").shell.pid)
        os.kill(shell, signal.SIGSTOP)
        with pytest.raises(NetworkError, match=r"^bob did not end .*: a signal has stopped its"):
            start_key_managers(network, KeyService())


@pytest.fixture
def keys(keys_network: Network) -> Keys:
    """Give the hosts of a network that stands, their stores filled."""
    found = Keys(keys_network)
    wait_until(lambda: found.stored() >= LOW, "keys of alice and charlie")
    return found


def test_curl_at_both_hosts_gets_the_same_key_once(keys: Keys) -> None:
    status, got = keys.curl("alice", "sae-charlie/enc_keys?size=512")
    assert status == 200, got
    (key,) = got["keys"]
    assert len(base64.b64decode(key["key"], validate=True)) == 64
    path = f"sae-alice/dec_keys?key_ID={key['key_ID']}"
    assert keys.curl("charlie", path) == (200, got)
    refused = 400, {"message": "one or more keys specified are not found on KME"}
    assert keys.curl("charlie", path) == refused


def test_an_application_of_charlies_does_not_get_the_key_of_another(keys: Keys) -> None:
    _status, got = keys.curl("alice", "sae-charlie/enc_keys")
    path = f"sae-alice/dec_keys?key_ID={got['keys'][0]['key_ID']}"
    shown = keys.network.runtime.own_folder("charlie")
    other = CertificateFiles(shown / "sae-web.pem", shown / "sae-web.key")
    words = f"--cert {other.certificate} --key {other.private_key}"
    assert keys.curl("charlie", path, words) == (401, None)
    assert keys.curl("charlie", path) == (200, got)


def test_who_has_no_certificate_of_the_authority_gets_no_answer(keys: Keys) -> None:
    address = "$KME/api/v1/keys/sae-charlie/status"
    output = keys.run("alice", f"curl -sS --cacert $KME_CA {address}; echo $?")
    assert output.split()[-1] != "0", output  # with TLS 1.3 it may hear why, or be cut off before
    assert "KME_ID" not in output
    output = keys.run("alice", f"{CURL} --tls-max 1.1 {address}; echo $?")
    assert output.split()[-1] == "35", output  # of curl: no TLS connection


# Opens silent connections, and keeps them until its input ends.
SILENT = """
import socket, sys
kept = []
for _ in range(int(sys.argv[3])):
    try:
        kept.append(socket.create_connection((sys.argv[1], int(sys.argv[2])), 5))
    except OSError:
        pass
print("connected", flush=True)
sys.stdin.read()
"""


def test_silent_connections_of_another_host_keep_nobody_from_keys(keys: Keys) -> None:
    manager, silent = keys.manager("alice"), 1010
    resource.prlimit(manager.pid, resource.RLIMIT_NOFILE, (1024, 1024))
    alice, bob = keys.network.host("alice"), keys.network.host("bob")
    words = [sys.executable, "-c", SILENT, alice.IP(), str(KEY_DELIVERY_PORT), str(silent)]
    pipe = subprocess.PIPE
    with bob.popen(words, stdin=pipe, stdout=pipe, text=True) as attacker:
        assert attacker.stdout.readline() == "connected\n"
        assert keys.curl("alice", "sae-charlie/status")[0] == 200
        files = len(os.listdir(f"/proc/{manager.pid}/fd"))
        assert files < 256, files  # of 1,024, of which its listener takes 64 for a peer
        attacker.stdin.close()
    keys.network.check()


def test_what_no_client_would_say_is_refused_and_the_next_one_is_served(
    keys: Keys, tmp_path: Path
) -> None:
    body = tmp_path / "body"
    for content, status in (
        (b"[" * 60_000, 400),
        (b'{"number": ' + b"9" * 5_000 + b"}", 400),
        (b"{" + b" " * 70_000 + b"}", 400),
        (b"\xff\xfe", 400),
        (b" " * (1 << 21), 400),
    ):
        body.write_bytes(content)
        output = keys.run(
            "alice",
            f'{CURL} --data-binary @{body} -o {tmp_path}/answer -w "%{{http_code}}" '
            '"$KME/api/v1/keys/sae-charlie/enc_keys"',
        )
        assert output.strip().endswith(str(status)), (content[:20], output)
    for words, status in (("-X DELETE", 405), ("-X PATCH", 405)):
        assert keys.curl("alice", "sae-charlie/enc_keys", words)[0] == status
    assert keys.curl("alice", "%ff/status")[0] == 400
    assert keys.curl("alice", "../../qmn/assignments", "--path-as-is")[0] == 404
    assignment = f'{CURL} -d "{{}}" -w "%{{http_code}}" "$KME/qmn/assignments"'
    assert keys.run("alice", assignment).endswith("400")
    noise = "head -c 5000 /dev/urandom > /dev/tcp/10.0.0.1/8443; echo done"
    assert "done" in keys.run("charlie", noise)
    assert keys.curl("alice", "sae-charlie/status")[0] == 200


def test_no_key_is_in_the_packets(keys: Keys) -> None:
    _status, got = keys.curl("alice", "sae-charlie/enc_keys?number=3")
    ids = [{"key_ID": key["key_ID"]} for key in got["keys"]]
    body = json.dumps({"key_IDs": ids})
    assert keys.curl("charlie", "sae-alice/dec_keys", f"--json '{body}'") == (200, got)
    logs = keys.network.runtime.logs
    captured = logs / "s1-eth1.pcap"
    packets = b"".join(bytes(packet) for packet in rdpcap(str(captured)))
    assert len(packets) > 10_000
    for key in got["keys"]:
        for file in logs.iterdir():
            assert key["key"].encode() not in file.read_bytes(), file
        assert base64.b64decode(key["key"]) not in packets
        assert key["key_ID"].encode() not in packets  # assignments are under TLS, too


def test_wireshark_reads_what_managers_say_by_the_runs_key_logs(keys: Keys) -> None:
    _status, got = keys.curl("alice", "sae-charlie/enc_keys")
    (key,) = got["keys"]
    logs = keys.network.runtime.logs
    for host in ("alice", "charlie"):
        assert (logs / f"kme-{host}.keys").stat().st_mode & 0o777 == 0o600

    def read() -> str:
        merged = merge(logs, logs / "merged.pcapng")
        words = ["-d", f"tls.port=={KEY_DELIVERY_PORT},http", "-Y", "http", "-T", "fields"]
        words += ["-e", "http.request.method", "-e", "http.file_data", "-e", "json.value.string"]
        done = subprocess.run(
            ["tshark", "-r", merged, *words],
            capture_output=True,
            text=True,
            check=True,
            timeout=SOON_S,
        )
        return done.stdout

    wait_until(lambda: key["key_ID"] in read(), "the assignment is read")
    assert key["key"] not in read()


def test_qkdsec_finds_nothing_that_fails(keys: Keys) -> None:
    # It asks for a key and its copy by one certificate: an application that is its own slave.
    words = "--cert $SAE_CERT --key $SAE_KEY --ca-cert $KME_CA --format json"
    output = keys.run("alice", f"{PROGRAMS}/qkdsec doctor $KME -s sae-alice {words}; echo $?")
    report, _, status = output.strip().rpartition("\n")
    assert status == "0", output
    counts = json.loads(report)["counts"]
    # The warning: it expects 404 for a key that is not there, where the standard has 400.
    assert counts == {"pass": 9, "warn": 1, "fail": 0, "skip": 0}
    warned = [each for each in json.loads(report)["results"] if each["status"] == "warn"]
    assert [each["name"] for each in warned] == ["error_contract_404"]


def test_qkdsec_gets_keys_of_light(keys: Keys) -> None:
    words = "--cert $SAE_CERT --key $SAE_KEY --ca-cert $KME_CA"
    output = keys.run("alice", f"{PROGRAMS}/qkdsec status $KME sae-charlie {words}; echo $?")
    assert output.strip().endswith("\n0"), output
    before = keys.stored()
    words += " --format json"
    output = keys.run("alice", f"{PROGRAMS}/qkdsec doctor $KME -s sae-charlie {words}")
    failed = [each for each in json.loads(output)["results"] if each["status"] == "fail"]
    # All but this: alice is not charlie, so she cannot fetch what he is to fetch.
    assert [each["name"] for each in failed] == ["dec_keys_roundtrip"]
    assert "KME returned HTTP 400" in failed[0]["summary"]
    assert before - keys.stored() in (4, 4 - HIGH // 2, 4 - HIGH)  # a session may come between


def test_a_client_library_gets_the_same_keys_at_both_ends(keys: Keys, tmp_path: Path) -> None:
    file = tmp_path / "client.py"
    file.write_text(CLIENT)
    python = f"{sys.executable} {file} ${{KME#https://}}"
    got = keys.run("alice", f"{python} enc sae-charlie").split()
    assert got[0] == "200", got
    assert len(got) == 5
    fetched = keys.run("charlie", f"{python} dec sae-alice {got[1]} {got[3]}").split()
    assert fetched == got


def test_stores_are_filled_again_to_the_mark(keys: Keys) -> None:
    count = keys.stored() - LOW + 1
    status, _got = keys.curl("alice", f"sae-charlie/enc_keys?number={count}")
    assert status == 200
    wait_until(lambda: keys.stored() >= HIGH, "the store is filled to its high mark")
