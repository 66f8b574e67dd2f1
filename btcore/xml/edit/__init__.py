"""Change the text of a document: edits that keep everything else as it is, and the fixes of diagnostics."""
