"""Bytes ⇄ messages, without sockets: Groot 2's protocol and the scene channel."""
