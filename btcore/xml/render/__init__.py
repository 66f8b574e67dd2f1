"""A tree as a picture: what is drawn, where, and how."""
