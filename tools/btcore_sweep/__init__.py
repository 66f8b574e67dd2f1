"""`btcore sweep`: run many episodes of a tree in parallel, and compute statistics.

See docs/guides/sweeps.md.
"""
