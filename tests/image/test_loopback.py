"""Pages and metrics of a network in a container, by a real Docker engine: .ci/run has one."""

import json
import re
import subprocess
import time
import urllib.request
from itertools import islice
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 120.0


def said_by(*command: str) -> str:
    """Return what a command prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def text_of(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=DEADLINE_S) as answer:  # noqa: S310
        text: bytes = answer.read()
        return text


def await_page(url: str) -> None:
    """Wait until the page of a network is served."""
    deadline = time.monotonic() + DEADLINE_S
    while True:
        try:
            urllib.request.urlopen(url, timeout=DEADLINE_S).close()  # noqa: S310
        except OSError:
            assert time.monotonic() < deadline, "the network has no page"
            time.sleep(0.1)
        else:
            return


ENGINE = subprocess.run([ROOT / "docker/engine"], stdout=subprocess.DEVNULL, check=False)
needs_engine = pytest.mark.skipif(ENGINE.returncode != 0, reason="no Docker engine answers")


@needs_engine
@pytest.mark.timeout(4 * DEADLINE_S)
def test_the_page_of_a_network_in_a_container_is_on_this_machines_loopback() -> None:
    volumes = said_by("docker", "volume", "ls", "--quiet")
    command = ["docker/run", "--input", "qmn", "cli", "sdc", "--live"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) as network:
        assert network.stdin is not None
        assert network.stdout is not None
        found = next(filter(None, (re.search(r"http://127\S+", line) for line in network.stdout)))
        page = f"{found[0]}1/"  # of the first network of a command
        await_page(f"{page}network.json")
        act = json.dumps({"act": "send", "from": "alice", "to": "bob", "text": "hello"}).encode()
        request = urllib.request.Request(  # noqa: S310
            f"{page}act", act, {"Content-Type": "application/json"}
        )
        with urllib.request.urlopen(request, timeout=DEADLINE_S) as answer:  # noqa: S310
            assert "bob received 'hello' from alice" in json.loads(answer.read())["output"]
        relays = said_by("docker", "ps", "--quiet", "--filter", f"name=qmn-live-{network.pid}-")
        assert len(relays.split()) == 1
        network.communicate("exit\n", timeout=DEADLINE_S)
    assert network.returncode == 0
    assert not said_by("docker", "ps", "--quiet", "--filter", f"name=qmn-live-{network.pid}-")
    assert said_by("docker", "volume", "ls", "--quiet") == volumes


@needs_engine
@pytest.mark.timeout(4 * DEADLINE_S)
def test_metrics_of_a_network_in_a_container_are_on_this_machines_loopback() -> None:
    command = ["docker/run", "--network", "host", "--input", "qmn", "cli", "sdc", "--metrics"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) as network:
        assert network.stdout is not None
        named = re.compile(r"metrics of (\S+): (http://127\S+)")
        found = filter(None, map(named.search, network.stdout))
        texts = {each[1]: text_of(each[2]) for each in islice(found, 3)}
        network.communicate("exit\n", timeout=DEADLINE_S)
    assert network.returncode == 0
    assert texts.keys() == {"c0", "dispatcher", "q1-agent"}
    assert all(b"qmn_" in text for text in texts.values())
