"""The language server: diagnostics, completion and navigation for documents of trees in an editor."""
