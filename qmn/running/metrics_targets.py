"""The addresses of a run's metrics, for Prometheus."""

import json
from pathlib import Path

TARGETS = "prometheus.json"  # for file_sd_configs of Prometheus
PATH = "/metrics"  # Prometheus asks for it by itself


def announce(addresses: dict[str, str], folder: Path) -> dict[str, str]:
    """Write a target for each program into the run's folder; return their URLs."""
    targets = [
        {"targets": [address], "labels": {"job": "qmn", "program": program}}
        for program, address in addresses.items()
    ]
    (folder / TARGETS).write_text(json.dumps(targets, indent=1) + "\n")
    return urls(addresses)


def urls(addresses: dict[str, str]) -> dict[str, str]:
    return {program: f"http://{address}{PATH}" for program, address in addresses.items()}
