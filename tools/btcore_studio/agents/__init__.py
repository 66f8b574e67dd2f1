"""A server of the Model Context Protocol, by which AI agents check, simulate and prove trees."""
