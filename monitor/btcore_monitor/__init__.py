"""The wire and the screen: publishes a running tree, watches any that publishes, shows and records it."""
