"""The machinery below nodes and links: what is asked of this machine, and of others."""
