"""Perception of the book: from readings to what they show."""
