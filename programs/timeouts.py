"""The waits of what every process does alike: seconds of the wall clock."""

METRICS_TIMEOUT_S = 5.0  # of who asks for metrics, from connecting to the last byte of the answer
