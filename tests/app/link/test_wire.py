"""What crosses the link has one version: messages that change alone would be refused without a reason."""

from __future__ import annotations

import json
from hashlib import sha256
from typing import Any

import msgspec

from app.link.wire import VERSION, FromJoints, FromLaptop, Packet

# Messages that changed need the next VERSION with their new hash; a class that was only renamed needs the hash alone.
SCHEMAS = (8, "9a298eec4f0ba2da")
PROSE = {"title", "description"}


def without_prose(schema: Any) -> Any:
    """The schema without class names and docstrings, which do not cross the link."""
    if isinstance(schema, dict):
        return {key: without_prose(one) for key, one in schema.items() if key not in PROSE or not isinstance(one, str)}
    return [without_prose(one) for one in schema] if isinstance(schema, list | tuple) else schema


def test_messages_that_change_have_another_version() -> None:
    schemas = msgspec.json.schema_components([FromLaptop, FromJoints, Packet])
    content = json.dumps(without_prose(schemas), sort_keys=True).encode()
    assert b'"description": "' not in content  # Python 3.13 indents docstrings otherwise
    assert (VERSION, sha256(content).hexdigest()[:16]) == SCHEMAS
