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
