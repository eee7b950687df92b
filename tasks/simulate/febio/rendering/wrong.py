"""What the rendering program says of a template that is wrong."""


class Wrong(Exception):
    """What is wrong with a template: where, what, and what was expected."""
