"""`btcore studio`: serves the page to browsers on this machine, and the files that all pages share."""
