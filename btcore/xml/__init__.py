"""Trees as XML: read, checked, built and written."""
