"""Tables of devices, light paths and fibres, as the terminal shows them."""

from typing import Any

from rich.table import Table


def table(title: str, columns: tuple[str, ...], rows: list[list[str]]) -> Table:
    made = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for column in columns:
        made.add_column(column)
    for row in rows:
        made.add_row(*row)
    return made


def path_row(path: dict[str, Any], names: dict[str, str]) -> list[str]:
    hops = ", ".join(
        f"{switch_port(hop['dpid'], hop['in_port'], names)}->{hop['out_port']}"
        for hop in path["hops"]
    )
    ends = [path[name] for name in ("session", "from", "to", "source", "begin", "end")]
    return [*ends, f"{path['loss_db']:g} dB", hops]


def switch_port(dpid: str, port: object, names: dict[str, str]) -> str:
    """Return a port as a person names it: q1:3."""
    return f"{names.get(dpid, dpid)}:{port}"


def far_end(end: str, names: dict[str, str]) -> str:
    """Return where a fibre leads: a host's port as it is, a switch's as a person names it."""
    dpid, colon, port = end.rpartition(":")
    return switch_port(dpid, port, names) if colon else end


HOST_COLUMNS = (
    *("host", "state", "can", "fibres", "sessions", "pairs sent", "made", "received"),
    *("lost", "wrong", "in use", "overridden"),
)


def host_table(host: dict[str, Any]) -> Table:
    """Return one host, each of what is known a line: a terminal of 80 columns has room for it."""
    shown = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for column, text in zip(HOST_COLUMNS, host_row(host), strict=False):
        shown.add_row(column, text)
    return shown


def counted(number: int, thing: str) -> str:
    """Return a number of things in words, as 1 byte and 2 bytes."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def host_row(host: dict[str, Any]) -> list[str]:
    if "ports" not in host:
        return [host["name"], host["state"], features_of(host)]
    fibers = " ".join(f"{port['name']}{'' if port['up'] else ' (cut)'}" for port in host["ports"])
    counts = [number_text(host[f"pairs_{what}"]) for what in ("sent", "made", "received", "lost")]
    return [
        host["name"],
        state(host),
        features_of(host),
        fibers,
        number_text(sum(host["sessions"].values())),
        *counts,
        number_text(host["symbol_errors"]),
        settings(host["in_use"]) or "-",
        settings(host["overrides"]) or "-",
    ]


def features_of(host: dict[str, Any]) -> str:
    features = host.get("features")
    if features is None:
        return "unknown"
    texts = {"store": f"store {host['memory_qubits']:,}"}
    return " ".join(texts.get(feature, feature) for feature in features) or "nothing"


def state(device: dict[str, Any]) -> str:
    """Return "up", or since when nothing was heard."""
    if device["state"] == "up":
        return "up"
    return f"{device['state']} since {device['heard_s_ago']:.0f} s"


def settings(values: dict[str, Any]) -> str:
    texts = {
        "rate_hz": "{:,} Hz",
        "frame_bytes": "{} B",
        "fec": "FEC {}",
        "interleave": "interleaving {}",
        "wavelength_pm": "{:,} pm",
    }
    there = {name: value for name, value in values.items() if value is not None}
    return ", ".join(texts[name].format(value) for name, value in there.items())


def number_text(value: float | None) -> str:
    """Return a number for a person, "-" where there is none."""
    return "-" if value is None else f"{value:,}"
