"""The waits of the controller: seconds.

Those of sessions are of the network. Those of fibres and devices are of the wall clock where that
paces time, and of the network in stepped time, in the background; all others are of the wall clock.
"""

# Beginning and ending
READY_TIMEOUT_S = 10.0  # until the apps listen to the switches
READY_POLL_S = 0.01  # between two looks whether they do
CONNECT_TIMEOUT_S = 5.0  # of a switch, until TLS has begun
NO_ECHO_S = 1e6  # between two echoes to a switch, where time is stepped
STATION_TIMEOUT_S = 60  # that a switch knows a station by which nothing comes

# Sessions
SESSION_TICK_S = 0.2  # between two looks at what has waited too long
WATCH_TICK_S = 0.05  # between two looks at idle light: the first before a job begins
QUEUE_LOOK_S = 1.0  # between two looks at all that wait, whether light has become free or not
NODE_TIMEOUT_S = 3.0  # for all answers; orders are sent again meanwhile
MONITOR_BEGIN_S = 10.0  # from the request of a link monitor until its session stands, or fails
PREEMPTION_S = 0.5  # for the opener of a link monitor to end it, before its light is taken
SWITCH_GRACE_S = 10.0  # for a switch whose agent is started again
COUNTING_S = 1.2  # until a switch has counted what has passed; Open vSwitch does it twice a second
DISCOVERY_S = 5.0  # until switches, fibres and hosts are known again
HELD_UP_S = 10.0  # hosts wait so long for the answer to a set-up message
ASKED_S = 2 * HELD_UP_S  # that a session is asked for, which then is left to its silence

# Fibres
LINK_PERIOD_S = 2.0  # between two announcements of a port
LINK_FAST_PERIOD_S = 0.2  # the same, of the first ones
LINK_EXPIRY_S = 7.0  # three periods, and what a busy machine adds where the wall paces time
LINK_TTL_S = 120  # until who hears an announcement may forget it

# Hosts' devices
SET_TIMEOUT_S = 3.0  # until a node has changed a setting
SILENT_S = 4.0  # without a word of a host: its links carry no relays
DEVICE_TICK_S = 0.1  # between two looks at who must be asked again

# Console
REQUEST_TIMEOUT_S = 5.0  # until a question is here as a whole
ANSWER_TIMEOUT_S = 5.0  # until an app has answered it
NO_FILES_WAIT_S = 0.1  # before the next attempt to accept without a free descriptor
