"""The commands `btcore stats` and `btcore diff`."""
