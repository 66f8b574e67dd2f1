"""Bytes ⇄ messages, without sockets: the protocols of Groot 1 and Groot 2, and the scene channel."""
