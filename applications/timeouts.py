"""The waits of applications and of their services: seconds of the network by default."""

# Keys
# An end that corrects a million errors is busy for so long at most, where the wall paces time.
KEYS_TIMEOUT_S = 45.0
FETCH_TIMEOUT_S = 3600.0  # keys that nobody fetches for so long are thrown away
STORING_TIMEOUT_S = 2.0  # one end stores the keys of a session before the other
STORING_LOOK_S = 0.05  # between two looks whether it has
CAPACITY_TIMEOUT_S = 30.0  # until there is room in a full store; less than KEYS_TIMEOUT_S
CAPACITY_LOOK_S = 0.2  # between two looks whether there is
FILLING_PAUSE_S = 5.0  # after sessions for keys that have failed, at most

# Key managers
CLIENT_IDLE_S = 60.0  # that a client may keep a connection open without a request
# By the wall where that paces time, else of the network: of reports in the background
LINKS_PERIOD_S = 1.0  # between two reports of key links to the controller
ROUTE_PAUSE_S = 0.3  # until the controller is asked again by whom keys can go
ROUTE_TIMEOUT_S = 3.0  # until it has answered

# Telemetry of switches, by the wall
TELEMETRY_PERIOD_S = 1.0  # between two looks, unless a subscription says another
TELEMETRY_LEAST_S = 0.1  # the shortest that it can say

# Sabot in a process of its own, by the wall
SIMULATION_TIMEOUT_S = 60.0  # the largest blocks take seconds
SIMULATOR_STOP_GRACE_S = 0.2  # that calls have to end by themselves
SIMULATOR_STOP_TIMEOUT_S = 5.0  # behind the grace, for what calls still have to say

# Instruments, by the wall
SCPI_POLL_S = 1.0  # between two questions for values that an instrument does not report

# Interception
RESENT_TIMEOUT_S = 1.0  # for light that has come to an interceptor; its session may be over

# Processing units
WANTED_TIMEOUT_S = 120.0  # until both applications want the pairs that one of them has asked for
FREE_TIMEOUT_S = 60.0  # until others have given back the light that these pairs need

# IP over light
HOLDOFF_S = 1.0  # by the wall: after a refusal nobody asks for light again so soon
LIGHT_RETRY_S = 0.05  # by the wall: between two requests for light of packets that wait
YIELD_S = 0.1  # by the wall, without a packet: then others have the light, if this host wants some

# Applications, by the wall
COMMAND_TIMEOUT_S = 10.0  # until a command that sets an interface or a tunnel up has ended
TUNNEL_TIMEOUT_S = 10.0  # until a tunnel's daemon is ready, or the other end's application answers
TUNNEL_POLL_S = 0.02  # between two looks whether it is
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
