"""Why there is no session over the link, or no pairing: codes, rendered where people read them."""

from __future__ import annotations

from enum import Enum, auto


class LinkFault(Enum):
    """What the link refuses or misses."""

    BAD_ADDRESS = auto()  # address
    UNKNOWN_HOST = auto()  # host, detail
    NOBODY_ANSWERS = auto()  # host, limit_s
    NOT_PAIRED = auto()  # host
    NOT_ADMITTED = auto()  # host
    OLDER_HERE = auto()  # host, here, there
    OLDER_THERE = auto()  # host, here, there
    ANOTHER_LAPTOP = auto()  # session
    SESSION_RUNS = auto()  # session
    SESSION_OVER = auto()  # session
    NAME_INVALID = auto()
    SIGN_IN_NEEDED = auto()
    NOT_STARTED = auto()  # detail
    PORT_TAKEN = auto()  # port, detail
    HOST_HAS_HOST = auto()  # host
    CODE_WRONG = auto()  # left
    CODE_USED_UP = auto()
    CODE_MALFORMED = auto()
    NO_CODE = auto()  # host
    NO_SERVICE = auto()  # home
    NO_SUCH_PEER = auto()  # name
    KEYS_DAMAGED = auto()  # path


class LinkNotice(Enum):
    """What the link's process notes in the trail."""

    LAPTOP_CAME = auto()  # laptop
    LINK_RETURNED = auto()  # silent_s
    COMMAND_STALE = auto()  # command, age_s
    COMMANDS_LOST = auto()
    PEER_REFUSED = auto()  # laptop, why
    CLOCK_STEPPED = auto()  # step_s
    OTHER_CLOCK_STEPPED = auto()  # step_s
