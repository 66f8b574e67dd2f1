"""A page that shows a tree in a browser or an editor, follows its file, and can watch a running tree."""
