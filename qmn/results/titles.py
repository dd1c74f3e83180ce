"""The title of a run on a page: its job in words, before the name of its folder."""

from wire.light import registered_services

TITLES = {
    "sdc": "Superdense coding",
    "distribute": "Entanglement distribution",
    "swap": "Entanglement swapping",
    "load": "Heavy traffic",
    "keys": "Key managers",
    "vpn": "VPN",
    "netqasm": "NetQASM",
} | {service.name: service.title for service in registered_services()}


def title_of(folder: str) -> str:
    """Return the job of a folder in words, before its name; the name alone if it has none."""
    title = TITLES.get(folder.partition("-")[2])
    return f"{title} ({folder})" if title else folder
