"""The surroundings that NetQASM's SDK needs, on the hosts of our network.

Programs import netqasm.sdk.external, which only knows simulators by name: `installed` puts ours in
its place before a program is loaded.
"""
