"""What kgdfa refuses, in sentences a user can act on."""


class KgdfaError(Exception):
    """An image, model or rule set that cannot be used; the text says what, where and what to do."""
