"""The state of switches and hosts, and what is set on them."""
