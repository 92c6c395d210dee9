"""The report: what its numbers mean, and whose comments stand on it."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import pytest

from app.text.recorded import render_recorded
from logs import records as r
from logs.disk import Disk
from logs.journal import COMMENTS, append_signed
from logs.keys import ConsoleKey, by_fingerprint
from logs.line import canonical, seal
from logs.read import outline_of, records, session_paths
from logs.records import Record
from logs.report.charts import earlier
from logs.report.data import Spread, data_of
from logs.report.page import report
from logs.verify import Evidence
from testing.trails import write_sample
from tests.support.audit_trails import LAPTOP, Trail, moment, write_session


def test_what_acknowledged_an_event_that_came_again_did_not_acknowledge_the_first(
    tmp_path: Path, key: ConsoleKey
) -> None:
    raised = r.EventRaised(event="console-timeout", effect="hold", text="Look.")
    cleared = r.EventCleared(event="console-timeout", effect="hold")
    answer = r.Acknowledgement(events=("console-timeout",))
    # The second is acknowledged behind its end, as older trails have it.
    path = write_session(tmp_path, "s1", key, Disk(), (raised, cleared, raised, cleared, answer))
    found = [msgspec.structs.replace(one, monotonic_ns=at_s * 10**9) for at_s, one in enumerate(records(path))]
    data = data_of(outline_of(found), found, render_recorded)
    assert [event.acknowledged_after_s for event in data.events] == [None, 2.0]
    assert [one.longest_unacknowledged_s for one in data.kinds_of_events] == [2.0]


@pytest.mark.parametrize(
    ("values_ms", "shares"),
    [
        ((), (None, None, None)),
        ((7.0,), (7.0, 7.0, 7.0)),
        ((1000.0, 10.0), (505.0, 1000.0, 1000.0)),
        (tuple(range(20, 0, -1)), (10.5, 19, 20)),
        (tuple(range(1, 101)), (50.5, 95, 100)),
    ],
)
def test_half_and_most_of_few_latencies_are_not_too_high(
    values_ms: tuple[float, ...], shares: tuple[float | None, ...]
) -> None:
    spread = Spread(name="x", values_ms=values_ms)
    assert tuple(spread.share(quantile) for quantile in (0.5, 0.95, 1.0)) == shares


def test_a_joint_that_is_held_nowhere_is_drawn_without_an_error(tmp_path: Path, key: ConsoleKey) -> None:
    """As on the screen its target is then where it is, and not 0°."""
    angles, unknown = (0.5, 1.0, 0.5, 1.0), (None,) * 4
    free = r.JointStatistics(
        period_s=1.0,
        angle_min_rad=angles,
        angle_mean_rad=angles,
        angle_max_rad=angles,
        target_mean_rad=unknown,
        torque_min_nm=unknown,
        torque_mean_nm=unknown,
        torque_max_nm=unknown,
        temperature_c=unknown,
    )
    held = msgspec.structs.replace(free, target_mean_rad=(0.25,) * 4)
    found = list(records(write_session(tmp_path, "s1", key, Disk(), (free, held))))
    traces = data_of(outline_of(found), found, render_recorded).joints
    assert [trace.target_deg for trace in traces] == [(math.degrees(angle), math.degrees(0.25)) for angle in angles]


def commented(trail: Trail, text: str, about: Record, name: str = "s1") -> Path:
    path = trail.folder / f"{name}{COMMENTS}"
    body = r.Comment(about_sequence=about.sequence, about_hash=about.hash, text=text, key=trail.key.public.fingerprint)
    append_signed(path, f"comments {name}", [body], trail.key, moment(9))
    return path


def test_only_comments_of_a_sound_file_about_this_sessions_records_are_on_its_report(three: Trail) -> None:
    mine, others = records(three.folder / "s1.jsonl")[3], records(three.folder / "s2.jsonl")[4]
    path = commented(three, "was tired", mine)
    evidence = Evidence(keys=three.keys)
    page = report(three.folder / "s1.jsonl", evidence, render_recorded)
    assert ("<td>was tired</td>" in page, "not shown" in page) == (True, False)
    commented(three, "of another", others)
    page = report(three.folder / "s1.jsonl", evidence, render_recorded)
    assert ("<td>was tired</td>" in page, "of another" in page) == (True, False)
    assert "Comments in s1.comments.jsonl that are not shown" in page
    path.write_bytes(path.read_bytes().replace(b"was tired", b"was drunk"))
    page = report(three.folder / "s1.jsonl", evidence, render_recorded)
    assert "drunk" not in page
    assert "Unproven comments in s1.comments.jsonl are not shown: TAMPERED" in page
    assert '<section class="proof sound">' in page


def test_what_the_other_computers_trail_holds_is_not_reported_as_none(tmp_path: Path, key: ConsoleKey) -> None:
    found = records(write_session(tmp_path, "s1", key, Disk(), (r.PatientChosen(patient="P-1"),), start=LAPTOP))
    here = outline_of(found)
    assert (here.joints_host, here.steps, here.stops, here.distance_m) == ("exo", None, None, None)
    page = report(tmp_path / "s1.jsonl", Evidence(keys=by_fingerprint([key.public])), render_recorded)
    numbers = page.split('<section class="numbers">')[1].split("<h2>")[0]
    assert numbers.count("<b>–</b>") == 6
    assert "The legs of s1 were those of the computer exo" in numbers
    with_control = [*found, msgspec.structs.replace(found[-1], process="control")]
    assert (outline_of(with_control).joints_host, outline_of(with_control).steps) == ("", 0)
    drawn = earlier([here, outline_of(with_control)], lambda name, **_: name)
    assert (drawn.count(">–</text>"), drawn.count(">0</text>")) == (3, 2)


def test_an_unreadable_session_is_left_out_of_the_earlier_ones(tmp_path: Path) -> None:
    unreadable, *_ = (write_sample(tmp_path, minutes=1, seed=seed) for seed in (1, 2, 3))
    last = session_paths(unreadable.parent)[-1]
    before = report(last, Evidence(), render_recorded).count('class="bar')
    unreadable.unlink()
    unreadable.symlink_to("/proc/self/mem")  # a regular file that can't be read, by root either
    assert report(last, Evidence(), render_recorded).count('class="bar') == before - 3


def test_a_forged_comment_in_a_torn_end_is_never_shown(three: Trail) -> None:
    """By who writes the trails alone: in its place in the chain and with its hash, but unsigned."""
    session = three.folder / "s1.jsonl"
    path = commented(three, "was tired", records(session)[3])
    newest = records(path)[-1]
    values = {name: getattr(newest, name) for name in r.Payload.__struct_fields__}
    values["body"] = msgspec.structs.replace(newest.body, text="was forged")
    line, _ = seal(canonical(r.Payload(**values | {"sequence": newest.sequence + 1, "previous": newest.hash})))
    with path.open("ab") as file:
        file.write(line[:-1])
    for later in ([], ["was better"]):  # its record explains the torn end
        for text in later:
            commented(three, text, records(session)[3])
        page = report(session, Evidence(keys=three.keys), render_recorded)
        assert all(f"<td>{text}</td>" in page for text in ("was tired", *later))
        assert "forged" not in page


@pytest.mark.parametrize("whole_line", [False, True])
def test_signed_comments_before_a_torn_line_stay_on_the_report(three: Trail, whole_line: bool) -> None:
    session = three.folder / "s1.jsonl"
    path = commented(three, "was tired", records(session)[3])
    forged = path.read_bytes().replace(b"was tired", b"was forged")  # it reads like a record; its hash does not match
    with path.open("ab") as file:
        file.write(forged if whole_line else forged[:-1])
    page = report(session, Evidence(keys=three.keys), render_recorded)
    assert ("<td>was tired</td>" in page, "forged" in page) == (True, False)
    assert "s1.comments.jsonl are not shown: INCOMPLETE" in page
    commented(three, "was better", records(session)[3])  # it signs how the file was found
    page = report(session, Evidence(keys=three.keys), render_recorded)
    assert ("<td>was tired</td>" in page, "<td>was better</td>" in page, "forged" in page) == (True, True, False)
    assert "not shown" not in page
