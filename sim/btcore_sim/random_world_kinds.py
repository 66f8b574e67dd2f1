"""The kinds and sizes of random worlds.

They are apart from random_worlds.py, so that the command line knows them without importing OpenCV.
"""

KINDS = ("office", "home")

ROOMS = 6
"""Default number of rooms."""

MAX_ROOMS = 24
