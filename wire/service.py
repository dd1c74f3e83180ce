"""The parts of the dispatcher's service beside its messages: limits, tokens, sockets."""

TOKEN_KEY = "qmn-token"  # noqa: S105 - the name of the metadata entry
RUNNER = "runner"  # the node that the runner is
MAX_MESSAGE_BYTES = 8 << 20  # of either side
MESSAGE_LIMITS = [
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
]
# A proxy that the environment names is of no use inside the network.
CHANNEL_OPTIONS = [*MESSAGE_LIMITS, ("grpc.enable_http_proxy", 0)]


def metadata(token: str) -> tuple[tuple[str, str]]:
    """Return the metadata of a call by the node whose token this is."""
    return ((TOKEN_KEY, token),)


def cross_connects_socket(dispatcher: str) -> str:
    """Return the path of the socket for cross-connects beside the dispatcher's own."""
    return f"{dispatcher}-paths"
