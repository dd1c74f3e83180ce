"""NetQASM as its own programs write it, and what processing units and applications say beside."""
