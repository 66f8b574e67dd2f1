"""Read documents: from a file or a text to elements with their positions."""
