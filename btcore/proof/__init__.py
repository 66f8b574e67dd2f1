"""Exhaustive search over the states of a tree, to prove what holds in every run."""
