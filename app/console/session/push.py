"""What became of the last push that gave no command: kept long enough to be read. Pure."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.ipc.messages import TriggerReport

READABLE_NS = 5_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PushNote:
    """`said` in perception's own words; `cancelled`: a press was under way, else none had begun."""

    said: str = ""
    cancelled: bool = False
    since_ns: int = 0
    cancel_count: int = 0
    incarnation: int = 0


NOTHING_PUSHED = PushNote()


def note(before: PushNote, report: TriggerReport, now_ns: int) -> PushNote:
    """The note after one more report; a press that succeeds, and time, wipe it out."""
    if report.incarnation != before.incarnation:
        return PushNote(incarnation=report.incarnation, cancel_count=report.cancel_count)
    if report.cancel_count > before.cancel_count:
        return replace(
            before, said=report.cancel_reason, cancelled=True, since_ns=now_ns, cancel_count=report.cancel_count
        )
    if report.press_hint and not report.pressed:
        return replace(before, said=report.press_hint, cancelled=False, since_ns=now_ns)
    if report.pressed or now_ns - before.since_ns > READABLE_NS:
        return replace(before, said="", cancelled=False)
    return before
