"""Text from a trail made safe for a terminal: characters that control the screen are escaped."""

from __future__ import annotations

_MOST = 10_000  # characters of one text; a person reads no more, a terminal chokes on it


def sanitize_terminal(text: str) -> str:
    """The text with every character that is not visible escaped as its code, and cut when it is too long.

    Not visible: control and format characters (bidirectional overrides among them), lone surrogates, private and
    unassigned ones, every separator but the space.
    """
    if len(text) > _MOST:
        text = f"{text[:_MOST]}… ({len(text)} characters)"
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else _escaped(character) for character in text)


def _escaped(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
