"""The command line: a file for each command; `main` also loads the commands of other packages."""
