"""Controllers of the book: from readings to commands, without trees."""
