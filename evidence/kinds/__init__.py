"""Experiments as kinds of `qmn lab`: each has `names`, for the list, and describes its options."""
