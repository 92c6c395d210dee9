"""rleex audit: verify, read, query and report the audit trail."""

from __future__ import annotations

import typer

from app.cli.audit import query, show, verify

cli = typer.Typer(no_args_is_help=True)
for subject in (verify, show, query):
    cli.add_typer(subject.cli)
