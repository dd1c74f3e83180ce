"""The waits of what every process does alike: seconds of the wall clock."""

METRICS_TIMEOUT_S = 5.0  # of who asks for metrics, from connecting to the last byte of the answer
SHARES_LOOK_S = 1.0  # between two looks at the connections that gRPC has
HANDSHAKE_TIMEOUT_S = 30  # of who connects to a gRPC server, until HTTP/2 has begun
SILENT_S = 60  # until a gRPC server asks who says nothing for an answer; and until it must be there
FRESH_S = 0.1  # that a table of connections is used: another user may have a port afterwards
STALL_S = 0.2  # of the wall, without a packet or a leap: an acknowledgement may be awaited
