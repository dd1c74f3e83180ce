"""The waits of the dispatcher: seconds.

Those that wait for light are of the network, all others of the wall clock.
"""

# Server
STOP_GRACE_S = 0.2  # that calls have to end by themselves
STOP_TIMEOUT_S = 1.0  # behind the grace, for what calls still have to say

# Requests
MAX_TIMEOUT_S = 60.0  # that a request may wait for light
MAX_HERALD_S = 86_400.0  # that a station may attempt for a block
MAX_PAUSE_S = 1.0  # between two messages to a watcher
ANALYSER_WAIT_S = 5.0  # of light at an input of a switch's analyser, for that of the other input
HERALD_BLOCK_S = 5.0  # that a switch's station attempts for a block
FIRST_HERALD_S = 60.0  # the same, until its first pair
MEMORY_WAIT_S = 5.0  # of light in a switch's memory until something releases it
RECEIVE_TIMEOUT_S = 1.0  # not needed: the light has come

# Events
WRITING_DELAY_S = 0.01  # that they are gathered for before they are written
