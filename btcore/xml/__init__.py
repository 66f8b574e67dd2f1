"""Trees in XML: read, check, plan, convert and draw them, and create their nodes."""
