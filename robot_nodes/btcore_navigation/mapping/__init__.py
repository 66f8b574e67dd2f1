"""Mapping while driving: scan matching, loop closure, and the search for unexplored frontiers."""
