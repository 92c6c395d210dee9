"""The push as a trace: what happened is marked where it happened."""

from __future__ import annotations

import pytest

from app.console.widgets.panel import Lines
from app.console.widgets.push import Mark, MarkKind, Push, draw_push
from app.ipc.messages import TriggerReport
from kgdfa.gesture import Gesture

FRAME_NS = 50_000_000
WIDTH, ROWS = 60, 10
WHY = "cancelled: the hand was lost"


def report(number: int, distance_m: float | None, **more: object) -> TriggerReport:
    base: dict[str, object] = {
        "incarnation": 1,
        "sequence": number,
        "captured_ns": number * FRAME_NS,
        "sent_ns": number * FRAME_NS,
        "hand": True,
        "gesture": Gesture.FIVE,
        "safe_distance_m": distance_m,
        "distance_m": distance_m,
        "distance_sd_m": 0.01,
    }
    return TriggerReport(**(base | more))  # type: ignore[arg-type]


def drawn(push: Push, number: int, width: int = WIDTH, rows: int = ROWS) -> Lines:
    return draw_push(push, number * FRAME_NS, 0.20, width, rows)


def rows_of(lines: Lines) -> list[str]:
    return ["".join(text for text, _ in line) for line in lines]


def test_press_and_release_stand_under_and_over_the_threshold() -> None:
    push = Push()
    for number in range(1, 61):
        pressed = 20 <= number < 40
        push.take(
            report(
                number,
                0.12 if pressed else 0.30,
                pressed=pressed,
                release_count=int(number >= 40),
                released_gesture=Gesture.FIVE,
            ),
            "",
        )
    assert [mark.kind for mark in push.marks] == [MarkKind.PRESSED, MarkKind.RELEASED]
    text = rows_of(drawn(push, 60))
    threshold = next(at for at, row in enumerate(text) if "20 cm" in row)
    down = next(at for at, row in enumerate(text) if "▼" in row)
    up = next(at for at, row in enumerate(text) if "▲ 5" in row)
    assert up < threshold < down
    assert text[down].index("▼") < text[up].index("▲")


@pytest.mark.parametrize(("kind", "text"), [(MarkKind.PRESSED, ""), (MarkKind.RELEASED, "5"), (MarkKind.NOTHING, WHY)])
def test_nothing_stands_over_a_part_of_the_threshold(kind: MarkKind, text: str) -> None:
    """A sign or a letter over one of its digits would make another figure of it."""
    push = Push()
    push.take(report(1, 0.20), "")
    push.marks.append(Mark(FRAME_NS, kind, text))
    for number in range(1, 122):
        row = next(row for row in rows_of(drawn(push, number)) if row.strip())
        assert row.startswith("20 cm ") or row.strip().startswith(WHY)


def test_why_a_push_gave_nothing_is_written_at_its_point() -> None:
    push = Push()
    for number in range(1, 41):
        push.take(report(number, 0.30), WHY if number >= 20 else "")
    assert len(push.marks) == 1
    row = next(row for row in rows_of(drawn(push, 40)) if "✗" in row)
    column = WIDTH - 1 - (40 - 20) * FRAME_NS * WIDTH // 6_000_000_000
    assert abs(row.index("✗") - column) <= 1
    assert WHY in row
    assert row.index(WHY) in {row.index("✗") + 2, row.index("✗") - 1 - len(WHY)}


def test_in_a_narrow_panel_the_reason_is_broken_between_words_and_whole() -> None:
    push = Push()
    push.take(report(1, 0.30), "")
    push.take(report(2, 0.30), WHY)
    text = " ".join(row.strip() for row in rows_of(drawn(push, 2, width=20, rows=6)))
    assert all(word in text for word in WHY.split())


def test_it_leaves_after_six_seconds_and_nothing_is_drawn_without_a_hand() -> None:
    push = Push()
    push.take(report(1, 0.30), WHY)
    assert "✗" not in "".join(rows_of(drawn(push, 1 + 121)))
    empty = Push()
    for number in range(1, 20):
        empty.take(report(number, None), "")
    styles = {style for line in drawn(empty, 20) for text, style in line if text.strip()}
    assert styles == {"$warning"}, "nothing but the threshold"


def test_the_same_report_is_taken_once() -> None:
    push = Push()
    for _ in range(5):
        push.take(report(1, 0.30), "")
    assert len(push.samples) == 1
