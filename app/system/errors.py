"""What the application refuses, in sentences a user can act on."""


class AppError(Exception):
    """A configuration, process or session that can't go on; the text says what, where and what to do."""
