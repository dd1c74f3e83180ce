"""The waits of the command line: seconds of the wall clock."""

# Programs of a run
START_TIMEOUT_S = 15.0  # until an application listens
STALL_TIMEOUT_S = 60.0  # without progress of any application
NETQASM_STALL_TIMEOUT_S = 180.0  # the same; units, which wait for each other, say it first
LOAD_CHECK_S = 0.05  # between two looks whether the network is whole while sessions run
LOAD_LIMIT_S = 120.0  # of the network, for a session beside its holding time
REPORT_TIMEOUT_S = 120.0  # until the report of a run is drawn

# A network that runs
DISPATCHER_TIMEOUT_S = 15.0  # until the dispatcher has answered what it may have to compute
ORDER_TIMEOUT_S = 5.0  # for a fibre or a switch, beside its switching time
WATCH_TIMEOUT_S = 5.0  # until it can be reached to watch events
WATCH_POLL_S = 0.05  # between two looks at the file of a run's events
TRY_TIMEOUT_S = 15.0  # for a command by which `qmn doctor` tries the machine

# Sweeps
CLUSTER_TIMEOUT_S = 10.0  # until a Dask scheduler answers
NO_WORKER_TIMEOUT_S = 30.0  # that it may have no worker
EMULATED_READY_S = 10.0  # until a program that only a sweep has is ready
SWEEP_POLL_S = 0.1  # between two looks whether the sweep shall end

# Labs
LAB_RUN_TIMEOUT_S = 600.0  # for a whole run of a lab
RUN_END_TIMEOUT_S = 60.0  # for a run that is asked to end, to clean up
RUN_POLL_S = 0.1  # between two looks whether a run has ended

# Other machines
WORKERS_TIMEOUT_S = 20.0  # until as many Dask workers are there as machines are asked for
AGENT_END_TIMEOUT_S = 5.0  # until an agent has ended whose runner has gone

# Attacks
ATTACKER_TIMEOUT_S = 20.0  # until an attacker's program begins, or an answer to it
ATTACK_TIMEOUT_S = 60.0  # until an attack is over and has had its effect
QUIET_S = 1.5  # without news before its effect is counted
LIE_PERIOD_S = 0.1  # between two lies
BELIEF_TIMEOUT_S = 3.0  # until a host believes one: it heeds none for 1 s after another's word
SPEAKER_TIMEOUT_S = 5.0  # that an impostor waits for the next message, or for who connects

# Benchmarks
RUN_TIMEOUT_S = 120.0  # for a whole run with a message
MEASURE_TIMEOUT_S = 60.0  # for one measurement
CALL_TIMEOUT_S = 30.0  # for one call to the dispatcher
BASELINE_READY_TIMEOUT_S = 20.0  # until a baseline's program is ready
TURN_TIMEOUT_S = 10.0  # for one light path, or one packet
CLOSE_TIMEOUT_S = 5.0  # until a light path is taken down
PATH_POLL_S = 0.0002  # between two looks whether it is
IDLE_S = 5.0  # that a network without sessions is watched

# Command line
BACKGROUND_TIMEOUT_S = 300.0  # until programs in a host's background have ended
SWITCHES_TIMEOUT_S = 30.0  # until all switches have connected to the controller

# Live view
LIVE_PAUSE_MS = 60  # in which the dispatcher gathers events: a page draws a picture of them
LIVE_LINES_S = 0.05  # between two looks at what programs have written
LIVE_LIST_S = 0.02  # between two lists of messages to a page: of what came beside events
LIVE_SELDOM_S = 1.0  # the same, where all processors are in use
LIVE_LOOK_S = 2.0  # between two looks whether they are
LIVE_DEVICES_S = 1.0  # between two questions about devices and sessions
LIVE_HALL_S = 20.0  # the same, where a page is shown to all
LIVE_DRAWN_S = 5.0  # that a drawn handshake is shown again
LIVE_HEAD_S = 60.0  # for what is asked: browsers connect before they ask
LIVE_LOOK_AGAIN_S = 0.1  # between two looks whether the next network of a command runs
LIVE_ACT_S = 60.0  # for a command that a page asks for
LIVE_START_S = 60.0  # until the page of a run can be opened
LIVE_NEWEST_S = 0.15  # for what the dispatcher still gathers when a page is to end
LIVE_LAST_S = 1.0  # for the last words to those who read
