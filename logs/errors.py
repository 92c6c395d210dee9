"""What the audit trail refuses, in sentences a user can act on."""


class AuditError(Exception):
    """An audit file or key that cannot be used; the text says what, where and what to do."""
