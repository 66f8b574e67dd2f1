"""Trees in XML: read, define, plan and draw them."""
