"""The command line: one file a command, ``main`` finds those of other packages."""
