"""The differences between two versions of trees."""
