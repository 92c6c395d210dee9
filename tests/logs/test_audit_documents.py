"""The documents say what is so: the schema is current, and the commands for standard tools work as printed."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from logs.records import schema_text
from tests.support.audit_trails import Trail

DOCS = Path(__file__).parents[2] / "docs" / "reference"


def commands() -> list[str]:
    return re.findall(r"```sh\n(.*?)```", (DOCS / "audit.md").read_text(encoding="utf-8"), flags=re.DOTALL)


def run(script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", "-c", script], cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture
def desk(trail: Trail, tmp_path: Path) -> Path:
    """A reviewer's folder: a session and a public key."""
    desk = tmp_path / "desk"
    desk.mkdir()
    shutil.copy(trail.session, desk / "SESSION.jsonl")
    shutil.copy(trail.key.folder / "console.pub", desk / "console.pub")
    return desk


def test_the_schema_is_current() -> None:
    assert (DOCS / "audit-schema.json").read_text(encoding="utf-8") == schema_text(), "rleex audit schema > docs/…"


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_the_chain_is_checked_by_sha256sum_as_printed(desk: Path) -> None:
    chain = commands()[0]
    sound = run(chain, desk)
    assert (sound.returncode, sound.stdout, sound.stderr) == (0, "", "")
    session = desk / "SESSION.jsonl"
    session.write_bytes(session.read_bytes().replace(b"right leg forward", b"left leg forward!"))
    assert "changed" in run(chain, desk).stdout


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_the_signature_is_checked_by_openssl_as_printed(desk: Path) -> None:
    script = commands()[1]
    if shutil.which("xxd") is None:
        script = script.replace("xxd -r -p", "perl -ne 'chomp; print pack \"H*\", $_'")
    assert "Verified Successfully" in run(script, desk).stdout
    session = desk / "SESSION.jsonl"
    session.write_bytes(session.read_bytes().replace(b'"closing":true', b'"closing":false'))
    assert "Verified Successfully" not in run(script, desk).stdout
