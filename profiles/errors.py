"""What profiles refuse, in sentences a user can act on."""


class ProfileError(Exception):
    """A profile that is missing, broken or out of range; the text names the field, the range and what to do."""
