"""Edits of trees, for tools in which people or agents change trees."""
