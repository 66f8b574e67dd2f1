"""Show the defaults of the navigation's parameters in the API reference, without their other rules."""

from typing import Any

import griffe


class FieldDefaults(griffe.Extension):
    """Replaces `number_field(0.2, minimum=0.0)` by its first argument, the default."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **kwargs: Any) -> None:
        """Shorten the value of the attribute *attr*."""
        if isinstance(attr.value, griffe.ExprCall) and attr.value.canonical_name == "number_field":
            attr.value = attr.value.arguments[0]
