"""The tamper seal: pairs that watch a fibre."""
