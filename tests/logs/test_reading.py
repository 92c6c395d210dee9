"""What people get to read: lines, filters, reports, answers; and that hostile text does nothing there."""

from __future__ import annotations

import json
import shutil
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text
from typer.testing import CliRunner

from app.cli import cli
from app.text.recorded import render_recorded
from logs import records as r
from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.journal import MANIFEST
from logs.keys import ConsoleKey, by_fingerprint
from logs.read import NOT_A_RECORD, UnreadableLine, find_session, outline, outline_of, read, records, session_paths
from logs.reason import sanitize_terminal
from logs.report.charts import clock, timeline
from logs.report.data import data_of
from logs.report.page import report
from logs.show import Filter, RecordSelector, json_of, kind_of, line_of, record_text
from logs.verify import Evidence
from testing.trails import write_sample
from tests.support.audit_trails import Trail, write_session
from tests.support.catalogues import entries

HOSTILE = "\x1b]0;owned\x07\x1b[2J\u202e\u0085\x9b31m<script>alert(1)</script>\"'&{{7*7}}[bold]x[/]\r\n\x00"


@pytest.fixture
def hostile(tmp_path: Path, key: ConsoleKey) -> Path:
    """A session in which every text is an attack."""
    folder = tmp_path / "hostile"
    folder.mkdir()
    bodies = (
        r.PatientChosen(patient=HOSTILE),
        r.Note(text=HOSTILE),
        r.GestureOnset(gesture=HOSTILE, explanation=HOSTILE),
        r.Press(gesture=HOSTILE, captured_ns=1),
        r.Cancel(reason=HOSTILE),
        r.Refusal(reason=HOSTILE, source=HOSTILE, gesture=HOSTILE),
        r.Transition(from_state=HOSTILE, to_state=HOSTILE),
        r.EventRaised(event=HOSTILE, effect=HOSTILE, text=HOSTILE),
        r.ActionEnd(number=1, action=HOSTILE, source="x", from_state="y", to_state=None, outcome=HOSTILE),
        r.HeartbeatLost(stream=HOSTILE, age_ms=1.0),
        r.Note(text=HOSTILE),
        r.SignIn(name=HOSTILE, role=HOSTILE),
    )
    return write_session(folder, "s1", key, Disk(), bodies)


class Tags(HTMLParser):
    """Which elements and attributes a page really has."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}


@given(st.text(max_size=500))
def test_harmless_text_is_visible_or_spelled_out(text: str) -> None:
    shown = sanitize_terminal(text)
    assert shown.isprintable()
    assert all(character in shown for character in text if character.isprintable())


def test_plain_text_stays_as_it_is() -> None:
    assert sanitize_terminal("Größe 語 – 74° > 53°") == "Größe 語 – 74° > 53°"


def test_hostile_text_steers_no_terminal(hostile: Path) -> None:
    for record in read(hostile):
        line = line_of(record, render_recorded)
        assert isinstance(line, Text)
        assert line.plain.isprintable(), line.plain
        assert json_of(record).isascii()
        assert "\x1b" not in json_of(record)


def test_hostile_text_is_only_text_in_the_report(hostile: Path) -> None:
    page = report(hostile, Evidence(), render_recorded)
    tags = Tags()
    tags.feed(page)
    assert "script" not in tags.tags
    assert not {name for name in tags.attributes if name.startswith("on")}
    assert "\x1b" not in page
    assert "49" not in page.split("{{7*7}}", maxsplit=1)[0][-40:]
    assert "&lt;script&gt;" in page


def test_the_report_fetches_nothing(hostile: Path) -> None:
    tags = Tags()
    tags.feed(report(hostile, Evidence(), render_recorded))
    assert not tags.tags & {"img", "link", "script", "iframe", "object", "embed"}
    assert not tags.attributes & {"src", "href", "srcset"}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00\xff" * 100,
        "täxt\n".encode("utf-16"),
        b"[1]\n{}\nnull\n",
        b'{"body":{"kind":"new"},"wall":"\x1b[2J"}\n',
        b"x" * (3 << 20),
    ],
    ids=["empty", "binary", "utf-16", "other json", "newer", "endless line"],
)
def test_anything_can_be_shown_and_nothing_of_it_crashes(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "odd.jsonl"
    path.write_bytes(content)
    for record in read(path):
        assert isinstance(record, UnreadableLine)
        assert line_of(record, render_recorded).plain.isprintable()
    result = CliRunner().invoke(cli, ["audit", "verify", str(path)])
    assert result.exit_code in (1, 2)
    with pytest.raises(AuditError, match="TRAIL_EMPTY"):
        report(path, Evidence(), render_recorded)


@pytest.mark.parametrize("language", ["en", "zh"])
def test_every_kind_of_record_has_its_text(language: str) -> None:
    kinds = {key.removeprefix("Record.") for key in entries(language) if key.startswith("Record.")}
    assert kinds - {"line", "EventCounted"} == {kind.__name__ for kind in r.Body.__args__}, "Record.Kind in trail.po"


def test_a_sentence_survives_what_was_not_measured() -> None:
    body = r.GestureOnset(gesture=None, distance_m=None)
    assert record_text(body, render_recorded) == "gesture –, confidence 0.00"
    quad = (0.1, None, 0.1, 0.1)
    statistics = {name: quad for name in r.JointStatistics.__struct_fields__ if name.endswith(("rad", "nm", "_c"))}
    assert "–" in record_text(r.JointStatistics(period_s=1.0, **statistics), render_recorded)  # type: ignore[arg-type]


def test_a_distance_that_rests_on_an_assumed_focal_length_is_marked() -> None:
    press = r.Press(
        gesture="1", safe_distance_m=0.19, threshold_m=0.2, focal_source="assumed", anchor_method="measured"
    )
    assert "lens assumed" in record_text(press, render_recorded)
    for body in (
        msgspec.structs.replace(press, anchor_method="calibrated"),
        msgspec.structs.replace(press, focal_source="given"),
    ):
        assert "lens assumed" not in record_text(body, render_recorded)


@pytest.mark.parametrize(
    ("wanted", "kinds"),
    [
        (Filter(state="right"), {"transition"}),
        (Filter(event="lost"), {"event-raised"}),
        (Filter(gesture="1"), {"command"}),
        (Filter(kinds=("note", "stop")), {"note", "stop"}),
        (Filter(operator="nobody"), set()),
        (Filter(since="2999"), set()),
        (Filter(until="1999"), set()),
        (Filter(patient="P"), set()),
    ],
)
def test_a_filter_lets_through_what_it_states(trail: Trail, wanted: Filter, kinds: set[str]) -> None:
    selector = RecordSelector(wanted)
    passed = {record.body.__struct_config__.tag for record in records(trail.session) if selector.passes(record)}
    assert passed == kinds


def test_a_changed_line_is_shown_by_its_kind_and_hides_no_patients_session(tmp_path: Path, key: ConsoleKey) -> None:
    command = r.Command(number=1, action="step", source="gesture", state="standing")
    path = write_session(tmp_path, "s1", key, Disk(), (r.PatientChosen(patient="P-1"), command, r.Note(text="kept")))
    whole = path.read_bytes()

    def shown(data: bytes, wanted: Filter) -> list[str]:
        path.write_bytes(data)
        selector = RecordSelector(wanted)
        passed = [record for record in read(path) if selector.passes(record)]
        return [one.kind if isinstance(one, UnreadableLine) else kind_of(one.body) for one in passed]

    changed = whole.replace(b'"step"', b'"walk"')
    assert shown(changed, Filter(kinds=("command",))) == ["command"]
    assert shown(changed, Filter(kinds=("note",))) == ["note"]
    assert shown(whole[:-9], Filter(kinds=("note",))) == ["note", NOT_A_RECORD]
    assert shown(whole, Filter(patient="P-2", kinds=("note",))) == []
    for line in (whole.replace(b"P-1", b"P-3"), whole.replace(b'"patient":"P-1"', b'"patient":P-1')):
        assert shown(line, Filter(patient="P-1", kinds=("note",)))[-1:] == ["note"]


@pytest.mark.parametrize(
    ("until", "passes"),
    [
        ("2026-11-21", True),
        ("2026-11-21T09:30", True),
        ("2026-11-21T09:30:10", True),
        ("2026-11-21T09:30:10.123456", True),
        ("2026-11-20", False),
        ("2026-11-21T09:29", False),
        ("2026-11-21T09:30:09", False),
        ("2026-11-21T09:30:10.123455", False),
    ],
)
def test_until_takes_in_the_moment_that_it_names(trail: Trail, until: str, passes: bool) -> None:
    record = msgspec.structs.replace(records(trail.session)[0], wall="2026-11-21T09:30:10.123456Z")
    assert RecordSelector(Filter(until=until)).passes(record) is passes


def test_a_session_is_found_by_the_beginning_of_its_name(three: Trail) -> None:
    assert find_session(three.folder, "s2").name == "s2.jsonl"
    assert find_session(three.folder, "last").name == "s3.jsonl"
    assert [path.stem for path in session_paths(three.folder)] == ["s1", "s2", "s3"]
    with pytest.raises(AuditError) as raised:
        find_session(three.folder, "s")
    assert (raised.value.code, raised.value.values["matches"]) == (AuditFault.AMBIGUOUS_SESSION, 3)
    (three.folder / "s3.jsonl").unlink()
    (three.folder / "s2.jsonl").unlink()
    assert find_session(three.folder, "s").name == "s1.jsonl"
    for name in ("x", ""):  # an empty name, as of an unset variable of a shell, means none
        with pytest.raises(AuditError) as raised:
            find_session(three.folder, name)
        assert raised.value.code is AuditFault.NO_SESSION


def test_the_last_session_is_the_one_begun_last_whatever_the_clock_was_set_to(tmp_path: Path, key: ConsoleKey) -> None:
    for name in ("1200", "0900", "1000"):
        write_session(tmp_path, name, key, Disk())
    assert find_session(tmp_path, "last").stem == "1000"
    (tmp_path / "1000.jsonl").unlink()
    assert find_session(tmp_path, "last").stem == "0900"
    shutil.copy(tmp_path / "0900.jsonl", tmp_path / "1300.jsonl")  # one of another computer, which the manifest lacks
    assert find_session(tmp_path, "last").stem == "0900"
    (tmp_path / MANIFEST).unlink()
    assert find_session(tmp_path, "last").stem == "1300"


def test_where_no_session_was_recorded_none_is_missed_by_name(tmp_path: Path) -> None:
    with pytest.raises(AuditError) as raised:
        find_session(tmp_path, "last")
    assert raised.value.code is AuditFault.NO_TRAILS


def test_the_report_counts_what_the_trail_holds(tmp_path: Path) -> None:
    write_sample(tmp_path, minutes=3, seed=1)
    path = write_sample(tmp_path, minutes=5, seed=2)
    found = records(path)
    summary = outline(path)
    assert summary.actions == sum(isinstance(record.body, r.Command) for record in found)
    page = report(path, Evidence(), render_recorded)
    assert f"{summary.completed}/{summary.actions}" in page
    steps = sum("step" in record.body.action for record in found if isinstance(record.body, r.ActionEnd))
    assert steps > 3
    assert f"<b>{steps}</b><span>steps</span>" in page
    assert summary.distance_m == pytest.approx(0.3 * steps)
    assert f"<b>{summary.distance_m:.1f} m</b>" in page
    assert "This patient&#39;s sessions" in page or "This patient's sessions" in page
    assert page.count("<svg") == 1 + 4 + 1 + 1
    for reason in {record.body.reason for record in found if isinstance(record.body, r.Refusal)}:
        assert str(reason) in page


def test_what_nothing_ended_lasts_to_the_sessions_end_on_the_report(tmp_path: Path, key: ConsoleKey) -> None:
    stop, lost, ending = (
        r.EventRaised(event=event, effect=effect, text="Look.")
        for event, effect in (("stop", "hold"), ("no-camera", "refuse"), ("shutting-down", "hold"))
    )
    ended = (r.EventCleared(event="stop", effect="hold"), r.Acknowledgement(events=("stop",)))
    path = write_session(tmp_path, "s1", key, Disk(), (stop, *ended, stop, lost, ending))
    found = [msgspec.structs.replace(one, monotonic_ns=at_s * 10**9) for at_s, one in enumerate(records(path))]
    data = data_of(outline_of(found), found, render_recorded)
    end_s = data.outline.duration_s
    first_s, again_s, lost_s, ending_s = (event.at_s for event in data.events)
    assert (first_s, again_s, lost_s, ending_s) == (1.0, 4.0, 5.0, 6.0)
    sums = {one.event: (one.lasted_s, one.longest_unacknowledged_s) for one in data.kinds_of_events}
    assert sums == {
        "stop": (1.0 + end_s - again_s, end_s - again_s),
        "no-camera": (end_s - lost_s, None),  # it refuses while it lasts: nobody acknowledges it
        "shutting-down": (end_s - ending_s, None),
    }
    drawn = timeline(data, lambda key, **_: key)
    for at_s in (again_s, lost_s, ending_s):
        assert f"{clock(at_s)} – {clock(end_s)}</title>" in drawn


def test_files_of_a_session_that_went_on_stand_in_their_order(three: Trail) -> None:
    for part in (10, 2, 3):
        (three.folder / f"s1-{part}.jsonl").touch()
    names = [path.stem for path in session_paths(three.folder)]
    assert names == ["s1", "s1-2", "s1-3", "s1-10", "s2", "s3"]


def test_a_changed_trail_is_called_so_on_its_report(trail: Trail) -> None:
    trail.session.write_bytes(trail.session.read_bytes().replace(b"Look.", b"Fine."))
    page = report(trail.session, Evidence(keys=by_fingerprint([trail.key.public])), render_recorded)
    assert '<section class="proof tampered">' in page


def test_show_prints_json_that_programs_read(three: Trail) -> None:
    result = CliRunner().invoke(cli, ["audit", "show", str(three.session), "--json", "--kind", "note"])
    assert [json.loads(line)["body"]["text"] for line in result.output.splitlines()][-1] == "ä–語"
