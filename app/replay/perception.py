"""Vote and button again, from the recorded frames: every onset, hint, press, release and cancel with its values."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from msgspec.structs import replace

from app.perception.frames import CONFIDENCE_DIGITS, ClassifiedFrame, button_of, records_at_end, unpack
from app.perception.reporting import Scale, records_between
from app.replay.difference import Difference, difference, differences
from kgdfa.button_state import ButtonMode, ButtonPlace
from kgdfa.distance import Distance
from kgdfa.gesture import Decision, Explanation, HandRefusal, Verdict
from kgdfa.pipeline import Report
from kgdfa.recognition import Recognition, recognise
from logs.reason import Reason, key_of
from logs.records import Body, Button, Calibration, Cancel, Frames, GestureOnset, Hint, Press, Record, Release
from logs.show import kind_of

DECISIONS = (GestureOnset, Hint, Press, Cancel, Release)
NOT_REPLAYED = {"distance_m", "explanation"}  # shown beside the decision; vote and button do not take them
NO_EXPLANATION = Explanation(Decision.NO_GESTURE)


class PerceptionReplay:
    """Takes a session's records in their order."""

    def __init__(self) -> None:
        self.replayed = 0
        self.not_recorded = 0  # decisions whose frames the trail does not hold
        self._setup: tuple[ButtonPlace, ButtonMode] | None = None
        self._scale: Scale | None = None
        self._recognition = Recognition()
        self._before: Report | None = None
        self._frames = 0
        self._without = NOT_REPLAYED
        self._expected: deque[Body] = deque()
        self._newest: Record | None = None

    def take(self, record: Record) -> Iterator[Difference]:
        """What differs in one more record."""
        if record.process != "perception":
            return
        body = record.body
        if isinstance(body, Calibration):
            self._scale = Scale(
                anchor_m=body.anchor_m,
                anchor_method=body.method,
                focal_px=body.focal_px,
                focal_source=body.focal_source,
            )
        elif isinstance(body, Button):
            yield from self.end()
            self._setup, self._recognition, self._before, self._frames = button_of(body), Recognition(), None, 0
            self._without = NOT_REPLAYED if body.distance_source else NOT_REPLAYED | {"distance_source"}
        elif isinstance(body, Frames):
            yield from self.end()
            yield from self._run(record, body)
            self._newest = record
        elif isinstance(body, DECISIONS):
            yield from self._compare(record)

    def end(self) -> Iterator[Difference]:
        """Decisions of the frames so far that the trail does not hold."""
        while self._expected and self._newest is not None:
            missing = kind_of(self._expected.popleft())
            yield difference(self._newest, "decision", None, missing)

    def _run(self, record: Record, body: Frames) -> Iterator[Difference]:
        if self._setup is None or self._scale is None:
            return
        if body.number != self._frames:
            yield difference(record, "number", body.number, self._frames)
            self._setup = None  # nothing more can be decided as it was, until the button begins anew
            return
        for classified in unpack(body, self._recognition.hand):
            self._recognition = recognise(self._recognition, classified[0], *self._setup)
            now = _report(classified, self._recognition)
            self._expected.extend(records_between(self._before, now, self._scale))
            self._before = now
            self._frames += 1

    def _compare(self, record: Record) -> Iterator[Difference]:
        if isinstance(record.body, Hint) and _of_hands(record.body):
            return
        if self._setup is None:
            self.not_recorded += 1
            return
        self.replayed += 1
        if not self._expected:
            self._expect_end(record)
        if not self._expected:
            yield difference(record, "decision", kind_of(record.body), None)
            return
        yield from differences(_rounded(record), self._expected.popleft(), without=self._without)

    def _expect_end(self, record: Record) -> None:
        """Where no frame decided it: what ended with the camera or the session, after which frames begin anew.

        Nothing is missing without it: a perception that was killed has ended nothing, older ones never did.
        """
        ended = tuple(records_at_end(self._before, self._scale)) if self._scale is not None else ()
        if ended and isinstance(record.body, type(ended[0])):
            self._expected.extend(ended)
            self._recognition, self._before, self._frames = Recognition(), None, 0


def _of_hands(hint: Hint) -> bool:
    """Whether a hand was refused: which hand commands is decided on images, and not again."""
    code = hint.reason.code if isinstance(hint.reason, Reason) else ""
    return code in {key_of(refusal) for refusal in HandRefusal}


def _report(classified: ClassifiedFrame, recognition: Recognition) -> Report:
    """What the pipeline reported of that frame, as far as the decisions take it."""
    reading, confidence = classified
    vote, named = recognition.vote, reading.gesture
    distance_m = reading.distance_m
    return Report(
        captured_ns=reading.captured_ns,
        hand=None,
        verdict=Verdict(gesture=named, confidence=confidence, explanation=NO_EXPLANATION),
        gesture=vote.gesture,
        recognised_ns=vote.recognised_ns,
        votes=vote.votes,
        distance=None if distance_m is None else Distance(shown_m=distance_m, safe_m=distance_m, sd_m=0.0),
        depth_distance=None,
        button=recognition.button,
        vote_ns=vote.decided_ns,
        reading=reading,
    )


def _rounded(record: Record) -> Record:
    """With the confidence in the frames' digits."""
    if not isinstance(record.body, GestureOnset):
        return record
    confidence = round(record.body.confidence, CONFIDENCE_DIGITS)
    body = replace(record.body, confidence=confidence)
    return replace(record, body=body)
