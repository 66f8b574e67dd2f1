"""The command line: `commands` has a file for each command; the other files are shared by commands."""
