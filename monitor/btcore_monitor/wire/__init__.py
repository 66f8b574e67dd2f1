"""Encode and decode the messages of the protocols of Groot 1 and Groot 2, and of the run channel.

No module here uses sockets.
"""
