"""Training as values: the lesson that runs, the fingers that are wrong, and the score. Pure.

The score counts gestures that were shown, pushed and withdrawn one after the other without a slip. Skipping keeps it:
who can't form a gesture can raise it with the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from app.ipc.messages import TriggerReport
from kgdfa.gesture import FINGER_STATES, Decision, Finger, FingerState, Gesture
from logs.reason import Reason, key_of

LESSONS = tuple(Gesture)
_FINGER_OF = {key_of(finger): finger for finger in Finger}
WrongFinger = tuple[Finger, FingerState | None]  # and what it does instead, as far as that is known


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Gestures in a row: now, at best in this training, at best in earlier ones; None: there was none."""

    row: int = 0
    best: int = 0
    former: int | None = None

    @property
    def record(self) -> bool:
        """Whether this training is the best of all."""
        return self.former is not None and self.best > self.former

    def counted(self, *, learnt: bool, slipped: bool) -> Score:
        """The score after a push; a slip begins the row anew."""
        row = 0 if slipped else self.row + learnt
        return replace(self, row=row, best=max(self.best, row))


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """How far the learner is; `done` counts lessons of this round, each ends with a released push of its gesture."""

    done: int = 0
    learnt: int = 0  # of all rounds, skipped ones left out
    score: Score = Score()
    report: TriggerReport | None = None  # the newest

    @property
    def target(self) -> Gesture | None:
        """The gesture to show now; None when all twelve are learnt."""
        return LESSONS[self.done] if self.done < len(LESSONS) else None

    def skipped(self) -> Lesson:
        """On to the next gesture; after the last one another round begins."""
        return replace(self, done=0 if self.target is None else self.done + 1)


def advance(lesson: Lesson, report: TriggerReport) -> Lesson:
    """The lesson after a report: a new release of the wanted gesture completes it."""
    before = lesson.report
    if before is None or before.incarnation != report.incarnation or lesson.target is None:
        return replace(lesson, report=report)
    released = report.release_count > before.release_count
    learnt = released and report.released_gesture is lesson.target
    slipped = (released and not learnt) or report.cancel_count > before.cancel_count
    return Lesson(
        done=lesson.done + learnt,
        learnt=lesson.learnt + learnt,
        score=lesson.score.counted(learnt=learnt, slipped=slipped),
        report=report,
    )


def wrong_fingers(target: Gesture | None, report: TriggerReport | None) -> tuple[WrongFinger, ...]:
    """The fingers that keep the hand from being the wanted gesture.

    A hand that shows another gesture differs by that gesture's table; of one that shows none, the verdict names the
    finger whose measure decided.
    """
    if target is None or report is None or not report.hand or report.hand_refusal or report.gesture is target:
        return ()
    if report.raw_gesture is None:
        return tuple((finger, None) for finger in _named(target, report.explanation))
    return differences(target, report.raw_gesture)


def differences(target: Gesture, detected: Gesture) -> tuple[WrongFinger, ...]:
    """The fingers that differ from the wanted gesture, and what each does."""
    pairs = zip(Finger, FINGER_STATES[target], FINGER_STATES[detected], strict=True)
    return tuple((finger, got) for finger, wanted, got in pairs if wanted is not got)


def _named(target: Gesture, why: Reason | None) -> tuple[Finger, ...]:
    """The fingers in an explanation of why it is not this gesture; of another gesture's they say nothing."""
    if why is None or why.code != key_of(Decision.NOT) or why.values.get("gesture") != Reason(key_of(target)):
        return ()
    return tuple(sorted({_FINGER_OF[code] for code in _codes(why) if code in _FINGER_OF}))


def _codes(why: Reason) -> Iterator[str]:
    yield why.code
    for value in why.values.values():
        if isinstance(value, Reason):
            yield from _codes(value)
