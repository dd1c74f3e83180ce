"""The waits of a quantum switch's agent: seconds of the wall clock by default."""

# Open vSwitch
BARRIER_DEADLINE_S = 5.0  # until the bridge answers a barrier
SHOW_SOON_S = 0.002  # that a reply waits for the barrier's behind it, to go in one write
HOLD_DEADLINE_S = 5.0  # of the network: that a reply waits for those of its members that are late
CLOSE_DEADLINE_S = 0.5  # until a closed connection has taken its last messages

FIRST_RETRY_S = 0.05  # until the controller is called again at first
LAST_RETRY_S = 1.0  # the same, in the end

# Optics
CONDITION_DEADLINE_S = 15.0  # until the hardware has reported its condition, as a network starts
CALL_DEADLINE_S = 4.0  # until the hardware has executed a command
STEPPED_DEADLINE_S = 60.0  # the same of simulated hardware, while the network's time stands
IDLE_POLL_S = 0.25  # between two looks for light paths that carry nothing
