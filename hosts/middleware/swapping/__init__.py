"""Entanglement swapping: the links of a chain of repeaters, and what a repeater does.

    alice --- link 1 --- r1 --- link 2 --- r2 --- link 3 --- bob

The node nearer to the opener makes the pairs of a link, keeps half 0 of each in its memory and
sends half 1 to the next one, which stores it. A repeater makes Bell measurements of what it has of
both sides; the two bits of each travel on, from node to node, to the acceptor.
"""
