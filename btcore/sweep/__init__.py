"""Many episodes of one tree, over all cores or a cluster: ``btcore sweep``. See docs/sweeps.md."""
