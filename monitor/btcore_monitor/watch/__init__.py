"""Listening to a running tree, whoever runs it: nothing here knows the engine."""
