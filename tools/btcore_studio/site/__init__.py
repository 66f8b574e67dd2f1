"""The studio without an installation: its language server in a browser."""
