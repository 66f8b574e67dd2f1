"""What a tree can be made with, and is probably not meant: every warning of `btcore validate`."""
