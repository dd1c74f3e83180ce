"""The dispatcher's services on their sockets: callers, calls, orders, metrics."""
