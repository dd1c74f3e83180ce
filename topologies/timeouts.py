"""The waits of a network's runner: seconds of the wall clock."""

# Programs
READY_TIMEOUT_S = 20.0  # until a program is ready, or captures
PROGRAM_S = 0.5  # more, of each program that starts beside it: alone it takes 0.2 s
QUIET_START_S = 5.0  # of a start, before it says what it waits for, and then again
LEAP_TIMEOUT_S = 60.0  # until stepped time has reached an instant for which the runner waits
STOP_TIMEOUT_S = 5.0  # until one that was asked to has ended; then, until one that is killed has
STOP_WAITS = 4  # for so long, at most, for one that writes what it has to keep
END_TIMEOUT_S = 1.0  # until a process has ended whose socket is closed; from one signal to the next
DAEMON_END_TIMEOUT_S = 2.0  # the same, of a daemon that may write its memory to the disk first
POLL_S = 0.02  # between two looks at what is waited for
CLEAN_UP_TIMEOUT_S = 30.0  # of all of clean-up, and INTERFACE_S for each interface
OVERRUN_S = 1.0  # of each step of it after that
STOPPED_TIMEOUT_S = 10.0  # that a process may be stopped by a signal before the network ends
STOPPED_LOOK_S = 0.5  # between two looks for such a process
AGAIN_S = 0.5  # from which on a signal is another one: `timeout` and others send it twice at once
OUTPUT_TIMEOUT_S = 600.0  # that a reader of our output may pause
OUTPUT_LOOK_S = 0.1  # between two looks whether a signal makes that wait useless

# Programs that are forked
FORK_TIMEOUT_S = 20.0  # until the fork server has started a program
FORK_WAITS = 3  # for so long, at most, for a server that is at work

# Nodes
SHELL_TIMEOUT_S = 20.0  # until a node's shell has a prompt
NEIGHBOUR_TIMEOUT_S = 3.0  # until another machine, or the gateway to it, has answered ARP
COMMAND_TIMEOUT_S = 20.0  # until a command that sets a node or an interface up has ended
COMMAND_LOOK_S = 0.5  # between two looks whether a command's wait is of use
SHELL_POLL_MS = 50  # between two looks whether a shell is still there
IPERF_TIMEOUT_S = 10.0  # until iperf3 listens, and ends beyond the time that was asked for

# Open vSwitch
OPENVSWITCH_TIMEOUT_S = 30.0  # until it runs, or has gone
STOPPED_DAEMON_S = 1.0  # that a command waits for a daemon that a signal has stopped
OPENVSWITCH_COMMAND_TIMEOUT_S = 15.0  # until another command of Open vSwitch has ended
VSCTL_TIMEOUT_S = 10.0  # until ovs-vsctl has ended
INTERFACE_S = 0.1  # more, of each interface that it may add or take away: in quiet it takes 0.02 s
VSCTL_GRACE_S = 5.0  # after the time-out of its own
STAY_S = 0.5  # that no interface has gone in: the others stay until they are deleted
PROBE_MS = 5000  # without a word of the controller, until Open vSwitch by itself asks for one
STEPPED_PROBE_MS = 86_400_000  # the same, where time is stepped: a slow machine loses no switch
BUSY_MS = 20  # that a controller may need for each host before it answers
RECONNECT_MS = 1000  # between a bridge's attempts to find its controller, at most

# Other machines
AGENT_CONNECT_TIMEOUT_S = 20.0  # until agents have connected to the runner
AGENT_ANSWER_TIMEOUT_S = 15.0  # until one has done what it was asked
AGENT_END_TIMEOUT_S = 5.0  # until the channels to them are closed
CHANNEL_CLOSE_TIMEOUT_S = 1.0  # until an agent has closed its side; then it is not asked
BEAT_PERIOD_S = 1.0  # between two questions whether a machine is still there
LOST_TIMEOUT_S = 5.0  # that it may say nothing

# Fibres and files
CONSOLE_TIMEOUT_S = 10.0  # until the controller has answered a question
DISCOVERY_TIMEOUT_S = 20.0  # until the controller has found all fibres; more where copper is slow
HEARD_TIMEOUT_S = 15.0  # until it has heard that one was cut or mended; likewise
CUT_S = 2.0  # that a fibre which nobody has found is seen cut before that is the cause
CUT_LOOK_S = 0.5  # between two looks for such fibres
SETTLE_S = 1.0  # until the last packets have reached their captures
DISK_LOOK_S = 1.0  # between two looks at the disk
