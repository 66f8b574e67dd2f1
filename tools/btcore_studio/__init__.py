"""What people and programs use to write trees: the language server, the preview, and the tools for agents."""
