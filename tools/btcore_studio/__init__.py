"""What people and programs use to write trees: in editors and browsers, as commands, and as AI agents."""
