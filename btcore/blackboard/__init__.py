"""The blackboard: entries, scopes, remapping, and the ports that read and write it."""
