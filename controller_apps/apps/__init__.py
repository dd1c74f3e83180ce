"""The apps that Ryu or os-ken runs: each handler asks plain Python and sends what comes back."""
