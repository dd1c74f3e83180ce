"""The policy: permissions of sessions, settings of hosts, schedules of swaps."""
