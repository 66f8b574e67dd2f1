"""The commands of btcore: a file per command."""
