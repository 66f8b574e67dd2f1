"""A `Robot` over topics, services and actions, described by a YAML file."""
