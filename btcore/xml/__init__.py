"""Trees in XML: read, check, build and write them."""
