"""The configuration of one end of a VPN whose keys come from a key manager."""

from dataclasses import dataclass

from applications.keys.config import KEY_DELIVERY_PORT
from wire.config import Config

PROGRAMS = WIREGUARD, STRONGSWAN, TLS = "wireguard", "strongswan", "tls"
AGREEMENT_PORT = 9414  # where the end that follows hears the ids of keys


@dataclass(frozen=True)
class VpnConfig(Config):
    """A tunnel's end, the other end, and who the host's key manager takes this program for."""

    program: str  # one of PROGRAMS
    leads: bool  # whether it is this end that asks for new keys
    address: str  # of this host, where its key manager is, too
    other: str  # of the other host
    inside: str  # this end's address in the tunnel
    other_inside: str
    other_sae: str  # SAE ID of the other end
    certificate: str  # paths of PEM files
    key_file: str
    authority: str
    rotate_s: float  # a new key so often
    lifetime_s: float  # no key is used for longer; both are of the network
    private_key: str = ""  # WireGuard: this end's, base64; strongSwan: the IKE secret of both, hex
    peer: str = ""  # WireGuard: public key of the other end; base64
    interface: str = ""  # WireGuard, TLS: its name
    socket: str = ""  # strongSwan: path of charon's
    session_file: str = ""  # TLS: path at which OpenSSL is given a key
    prefix_length: int = 24  # of the addresses in the tunnel
    port: int = KEY_DELIVERY_PORT
