"""The waits of a host's stack and applications: seconds of the network by default.

The same wait has the same time-out in every service. Those that build on others say so.
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
KEYS_TIMEOUT_S = 45.0  # an end that corrects a million errors is busy for so long at most

# Light
MAX_BLOCK_S = 5.0  # that a block may last, from its first photon to its last
LIGHT_TIMEOUT_S = 2 * (ANSWER_TIMEOUT_S + MAX_BLOCK_S)  # of two blocks that take turns at a source
HERALD_TIMEOUT_S = ANSWER_TIMEOUT_S + MAX_BLOCK_S  # until a station has heralded a block
DOUBT_S = 0.3  # light that has not come so long after it is due is asked after at its source
GRACE_S = (
    0.3  # from the source's word that it has left until the QNIC is asked whether the light is lost
)
KEY_GRACE_S = 1.0  # the same, from when its last photon is due to be measured
ARRIVED_TIMEOUT_S = 0.1  # for light that the other end reports as sent
OUTCOME_TIMEOUT_S = 0.02  # the same, where its measurement was ordered: its outcome is on its way
EXPECTED_TIMEOUT_S = 10.0  # for light that nobody has announced
RESENT_TIMEOUT_S = 1.0  # for light that has come to an interceptor; its session may be over
ANALYSER_TIMEOUT_S = (
    10.0  # until a switch reports an outcome, 5 s of them for the light of the other end
)
DARK_LIMIT_S = 10.0  # without a single pair; the last few symbols of a message are small blocks
PAIR_TIMEOUT_S = 30.0  # until a pair with a handshake of its own is over

# Processing units
WANTED_TIMEOUT_S = 120.0  # until both applications want the pairs that one of them has asked for
FREE_TIMEOUT_S = 60.0  # until others have given back the light that these pairs need

# Light paths and chains of repeaters
DISCOVERY_TIMEOUT_S = 3.0  # until the controller has seen all fibres
FREEING_TIMEOUT_S = 1.0  # until the controller has heard that a session is over
RETRY_PAUSE_S = 0.1  # by the wall: between the first two requests for a light path, at most
LONGEST_RETRY_PAUSE_S = 0.8  # by the wall: between two later ones
ORDER_TIMEOUT_S = 5.0  # until the controller's order for a chain is here
LINK_TIMEOUT_S = 60.0  # until all links of a chain are open, each of which waits for the next one
BITS_TIMEOUT_S = 30.0  # until swaps are reported: they may pass many nodes over a slow network
UNUSED_S = LINK_TIMEOUT_S + 30.0  # an order that nobody has asked for so long is of one that broke

# Until the dispatcher answers an order, which may wait for light as long as above; by the wall
# what waits for none: a challenge, and a look.
DISPATCHER_TIMEOUT_S = 20.0

# Beside the sessions, by the wall
FASTEST_ANNOUNCEMENTS_S = 0.2  # between two at first
ANNOUNCEMENTS_HELD = 6  # until who has heard one may forget it, in the pauses between two
CHECK_PERIOD_S = 0.2  # between two looks at a device at work, whose changes are reported then
IDLE_CHECK_PERIOD_S = 5.0  # the same, of one that says itself when something changes
FIRST_REPORTS_S = 1.0  # between two to a controller without a subscription, at first
UNSUBSCRIBED_PERIOD_S = 10.0  # the same, in the end
SLOWER = 0.25  # a pause to the time that has passed, of what a host repeats until it is found

# IP over light
HOLDOFF_S = 1.0  # by the wall: after a refusal nobody asks for light again so soon
LIGHT_RETRY_S = 0.05  # by the wall: between two requests for light of packets that wait
YIELD_S = 0.1  # by the wall, without a packet: then others have the light, if this host wants some

# Applications, by the wall
CLOSING_TIMEOUT_S = 2.0  # until the stack has broken off a session whose socket is closed
COMMAND_TIMEOUT_S = 10.0  # until a command that sets an interface or a tunnel up has ended
TUNNEL_TIMEOUT_S = 10.0  # until a tunnel's daemon is ready, or the other end's application answers
TUNNEL_POLL_S = 0.02  # between two looks whether it is
LOOK_S = 0.1  # between two looks at the network of a program that waits for a session
TLS_KEY_S = 86_400  # whole ones, that a key of a tunnel of TLS waits for the other end to begin
KEY_MANAGER_TIMEOUT_S = 15.0  # until a key manager has answered
JOIN_TIMEOUT_S = 60.0  # until the other program of a NetQASM application connects
ROUND_TIMEOUT_S = 600.0  # until all of its programs have ended a round
TEXT_TIMEOUT_S = 5.0  # until its place for texts takes a connection
GREETING_TIMEOUT_S = 1.0  # until the peer has introduced itself
TEXT_PAUSE_S = 0.05  # between two attempts to connect

DOWNLOAD_TIMEOUT_S = 120.0  # without a byte of a download
DOWNLOAD_TELL_S = 0.5  # between two words of how far it is
NEXT_KEY_PAUSE_S = 0.25  # of a tunnel, when no key could be had
TUNNEL_HANDSHAKE_S = 15.0  # by the wall, as who holds it counts: until both ends use a new key
INITIATE_PAUSE_S = 0.25  # of strongSwan, between two attempts
KEEPALIVE_S = 1  # of WireGuard: the end that knows the other's address begins the handshake at once

# Key managers
FETCH_TIMEOUT_S = 3600.0  # keys that nobody fetches for so long are thrown away
STORING_TIMEOUT_S = 2.0  # one end stores the keys of a session before the other
STORING_LOOK_S = 0.05  # between two looks whether it has
CAPACITY_TIMEOUT_S = 30.0  # until there is room in a full store; less than KEYS_TIMEOUT_S
CAPACITY_LOOK_S = 0.2  # between two looks whether there is
FILLING_PAUSE_S = 5.0  # after sessions for keys that have failed, at most

# Key managers, by the wall
CLIENT_IDLE_S = 60.0  # that a client may keep a connection open without a request
LINKS_PERIOD_S = 1.0  # between two reports of key links to the controller
ROUTE_PAUSE_S = 0.3  # until the controller is asked again by whom keys can go
ROUTE_TIMEOUT_S = 3.0  # until it has answered
