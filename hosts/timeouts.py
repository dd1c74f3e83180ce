"""The waits of a host's stack and applications: seconds of the network by default.

The same wait has the same time-out in every service. Those that build on others say so. "By the
wall" is so where that paces time; stepped, they are of the network.
"""

# Between hosts
CONNECT_TIMEOUT_S = 5.0  # until another host's stack takes a connection
CONNECT_TRIES = 3  # where nobody says who has its address; each takes 3 s of the wall
ANSWER_TIMEOUT_S = 10.0  # until the other end answers what needs no light and no application
REPORT_TIMEOUT_S = 30.0  # until it answers what its application must have read
READ_TIMEOUT_S = REPORT_TIMEOUT_S - 5.0  # until an application reads: the other end hears of it
ACCEPT_TIMEOUT_S = 5.0  # until an application accepts the connection that it listens for
IDLE_TIMEOUT_S = 600.0  # between two messages of a session that nobody ends
LINGER_S = 1.0  # for the other end to hear why a session cannot go on, and to close

# Light
MAX_BLOCK_S = 5.0  # that a block may last, from its first photon to its last
LIGHT_TIMEOUT_S = 2 * (ANSWER_TIMEOUT_S + MAX_BLOCK_S)  # of two blocks that take turns at a source
WHOLE_HZ = 1  # of a block of which nobody wants a part: it may last for its pairs at this rate
HERALD_TIMEOUT_S = ANSWER_TIMEOUT_S + 60.0  # until a station has heralded a block
# Light that is not there so long after it is due is taken for lost. That is time for detectors and
# gates, and for software where the wall paces time: stepped, it takes none.
DOUBT_S = 0.3  # then its source is asked after it
GRACE_S = 0.3  # from the source's word that it has left until the QNIC is asked
KEY_GRACE_S = 1.0  # the same, from when its last photon is due to be measured
ARRIVED_TIMEOUT_S = 0.1  # for light that the other end reports as sent
OUTCOME_TIMEOUT_S = 0.02  # the same, where its measurement was ordered: its outcome is on its way
EXPECTED_TIMEOUT_S = 10.0  # for light that nobody has announced
ANALYSER_TIMEOUT_S = (
    10.0  # until a switch reports an outcome, 5 s of them for the light of the other end
)
DARK_LIMIT_S = 10.0  # without a single pair; the last few symbols of a message are small blocks
PAIR_TIMEOUT_S = 30.0  # until a pair with a handshake of its own is over

# Light paths, and lines of hosts
DISCOVERY_TIMEOUT_S = 3.0  # until the controller has seen all fibres
FREEING_TIMEOUT_S = 1.0  # until the controller has heard that a session is over
RETRY_PAUSE_S = 0.1  # by the wall: between the first two requests for a light path, at most
LONGEST_RETRY_PAUSE_S = 0.8  # by the wall: between two later ones
BITS_TIMEOUT_S = 30.0  # until outcomes are reported: they may pass many nodes over a slow network
UNUSED_S = 90.0  # an order that nobody has asked for so long is of a session that broke

# Until the dispatcher answers an order, which may wait for light as long as above; by the wall
# what waits for none: a challenge, and a look.
DISPATCHER_TIMEOUT_S = 20.0

# Beside the sessions, by the wall; stepped, in the background
FASTEST_ANNOUNCEMENTS_S = 0.2  # between two at first, and two reports to a controller unasked
ANNOUNCEMENTS_HELD = 6  # until who has heard one may forget it, in the pauses between two
CHECK_PERIOD_S = 0.2  # between two looks at a device at work, whose changes are reported then
IDLE_CHECK_PERIOD_S = 5.0  # the same, of one that says itself when something changes
UNSUBSCRIBED_PERIOD_S = 10.0  # between two reports to a controller unasked, in the end
SLOWER = 0.25  # a pause to the time that has passed, of what a host repeats until it is found

# Applications, by the wall in stepped time, too
CLOSING_TIMEOUT_S = 2.0  # until the stack has broken off a session whose socket is closed
LOOK_S = 0.1  # between two looks at the network of a program that waits for a session
