"""Read documents: parse a file or a text into elements with their positions."""
