"""Nav2: its tree nodes on its servers, and our navigation in the place of its servers."""
