"""Convert documents from format 3 to format 4, and keep every byte that needn't change."""
