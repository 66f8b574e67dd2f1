"""Maps made while driving: scans matched to one another, loops closed, and where nobody has looked yet."""
