"""The kernel's own calls: interfaces, namespaces, shares of memory, packet sockets."""
