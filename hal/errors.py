"""What hardware refuses, in sentences a user can act on."""


class HardwareError(Exception):
    """A device that is missing, broken or misconfigured; the text says what, where and what to do."""
