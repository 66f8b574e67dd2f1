"""Clients that watch the running tree of any robot; no module here imports the engine."""
