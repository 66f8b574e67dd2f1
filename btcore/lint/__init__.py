"""Find mistakes in trees that can be loaded: all warnings of `btcore validate`."""
