"""A trail that the program before schema 2 wrote (every kind of record, and a crashed session) still opens."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from app.ipc.states import Effect, GaitState
from app.text.catalogue import tr, use_language
from app.text.recorded import render_recorded
from logs import records as r
from logs.findings import Finding, Status
from logs.keys import by_fingerprint, known_keys, read_anchors
from logs.query import ask
from logs.read import read, records
from logs.reason import Reason
from logs.records_table import connect
from logs.report.page import report
from logs.show import Filter, RecordSelector, line_of
from logs.verify import Evidence, exit_status, verify

DATA = Path(__file__).with_name("data") / "schema1"


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A copy of the recorded home."""
    return Path(shutil.copytree(DATA, tmp_path / "home"))


def judged(home: Path) -> list[Finding]:
    keys = by_fingerprint(known_keys(home / "keys"))
    return verify([home / "logs"], Evidence(keys=keys, anchors=read_anchors(home / "keys")))


def test_it_verifies_with_its_crash_and_its_signatures(home: Path) -> None:
    findings = judged(home)
    found = {finding.file.stem: (finding.status, finding.records, finding.proven) for finding in findings}
    assert found == {
        "crashed": (Status.SOUND, 4, 0),
        "manifest": (Status.SOUND, 4, 4),
        "whole": (Status.SOUND, 41, 41),
    }
    assert exit_status(findings) == 0


def test_a_change_in_it_is_still_found(home: Path) -> None:
    path = home / "logs" / "whole.jsonl"
    path.write_bytes(path.read_bytes().replace(b"Shorter steps", b"Longer steps!"))
    (bad,) = (finding for finding in judged(home) if finding.status is Status.TAMPERED)
    assert (bad.file, bad.line) == (path, 36)


def test_every_record_is_understood_with_its_recorded_text(home: Path) -> None:
    found = records(home / "logs" / "whole.jsonl")
    assert len(found) == 41
    assert {record.schema for record in found} == {1}
    assert len({type(record.body) for record in found}) == 40
    (refusal,) = (record.body for record in found if isinstance(record.body, r.Refusal))
    assert refusal.reason == "There is no sit down from right leg forward."
    assert not any(isinstance(getattr(record.body, "reason", None), Reason) for record in found)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_it_is_shown_in_both_languages(home: Path, language: str) -> None:
    use_language(language)
    lines = [line_of(record, render_recorded).plain for record in read(home / "logs" / "whole.jsonl")]
    assert not [line for line in lines if "Record." in line]
    assert any("There is no sit down from right leg forward." in line for line in lines)
    stop = next(line for line in lines if " stop " in line)
    assert tr(GaitState.RIGHT_FORWARD) in stop
    assert tr(Effect.HOLD) in stop


def test_an_event_is_found_by_its_name_of_today(home: Path) -> None:
    selector = RecordSelector(Filter(event="camera-stale"))
    kinds = [type(record.body) for record in records(home / "logs" / "whole.jsonl") if selector.passes(record)]
    assert kinds == [r.EventRaised, r.EventCleared, r.Acknowledgement]


def test_it_is_queried_and_reported(home: Path) -> None:
    answer = ask(connect([home / "logs"]), "SELECT reason FROM records WHERE kind = 'refusal'").to_pylist()
    assert answer == [{"reason": "There is no sit down from right leg forward."}]
    page = report(home / "logs" / "whole.jsonl", Evidence(), render_recorded)
    assert "The camera gives no fresh picture" in page
    assert "There is no sit down from right leg forward." in page
