"""The interactive command line of a network: Mininet's own, with quantum verbs."""
