"""The records as JSON Schema, for readers in other languages; `docs/audit-schema.json` is made from it."""

from __future__ import annotations

from typing import Any

import msgspec

from logs.records import SCHEMA, Record


def json_schema() -> dict[str, Any]:
    """The schema of one line of a trail."""
    schema: dict[str, Any] = msgspec.json.schema(Record)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"rleex audit record, schema {SCHEMA}",
        **schema,
    }


def schema_text() -> str:
    """As it stands in the documents."""
    return msgspec.json.format(msgspec.json.encode(json_schema()), indent=1).decode() + "\n"
