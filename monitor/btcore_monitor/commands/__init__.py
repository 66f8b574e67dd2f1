"""The commands that the monitor adds to `btcore`: monitor, hook, record and replay."""
