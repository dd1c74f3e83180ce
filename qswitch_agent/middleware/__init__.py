"""The switch's middleware: what light can do, and which cross-connects the flow table asks for."""
