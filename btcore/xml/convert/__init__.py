"""From format 3 to format 4, keeping every byte that needn't change."""
