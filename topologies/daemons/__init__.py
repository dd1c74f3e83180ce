"""Programs that a running network can have on its hosts, beside their stacks."""
