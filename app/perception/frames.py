"""What vote and button took of each frame, as the trail's records: packed where it is seen, unpacked for a replay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import accumulate, pairwise

from msgspec import structs

from app.perception.reporting import Scale, records_between
from kgdfa.button_state import ButtonMode, ButtonPlace, PressCancel
from kgdfa.distance import DistanceChoice, DistanceSource
from kgdfa.gesture import Decision, Explanation, Gesture, Verdict
from kgdfa.pipeline import Report
from kgdfa.recognition import FrameReading
from logs.records import Body, Button, Frames

BATCH_FRAMES = 60  # two seconds: what a crash may lose of frames in which nothing was decided
CONFIDENCE_DIGITS = 4
# Of each frame: whether there is a hand, and whether another one commands than in the frame before. Capital: cut off.
MARKS = {(False, False): ".", (False, True): "x", (True, False): "h", (True, True): "n"}
PRESENT_OTHER = {mark: both for both, mark in MARKS.items()}
# Of each frame with a hand: what measured the distance, and whether by the depth map of a frame before.
SOURCES = {
    (DistanceSource.MONOCULAR, False): "m",
    (DistanceSource.DEPTH, False): "d",
    (DistanceSource.DEPTH, True): "r",
}
SOURCE_OF = {mark: source for source, mark in SOURCES.items()}
ClassifiedFrame = tuple[FrameReading, float]  # with the confidence of its verdict


def button_record(place: ButtonPlace, mode: ButtonMode, choice: DistanceChoice) -> Button:
    """The button as it is set up."""
    return Button(mode=mode.value, distance_source=choice.value, **asdict(place))


def button_of(record: Button) -> tuple[ButtonPlace, ButtonMode]:
    """The setup that a record holds. Raises ValueError for a rule that this version does not know."""
    place = ButtonPlace(x_px=record.x_px, y_px=record.y_px, radius_px=record.radius_px, threshold_m=record.threshold_m)
    return place, ButtonMode(record.mode)


@dataclass(slots=True)
class FrameBatch:
    """Collects frames; `take` gives their record and begins the next."""

    number: int = 0  # frames before those collected
    _hand: int = 0
    _frames: list[ClassifiedFrame] = field(default_factory=list)

    def add(self, reading: FrameReading, confidence: float) -> None:
        """One frame."""
        self._frames.append((reading, confidence))

    def take(self, *, at_once: bool) -> Iterator[Frames]:
        """The record of what was collected, if it is full or something was decided at the newest frame."""
        if not self._frames or not (at_once or len(self._frames) >= BATCH_FRAMES):
            return
        captures_ns = [reading.captured_ns for reading, _ in self._frames]
        with_hand = [(one, confidence) for one, confidence in self._frames if one.beside_px is not None]
        depth = any(one.source is DistanceSource.DEPTH for one, _ in with_hand)
        yield Frames(
            number=self.number,
            captured_ns=captures_ns[0],
            after_ns=tuple(after - before for before, after in pairwise(captures_ns)),
            hands="".join(self._mark(reading) for reading, _ in self._frames),
            gesture=tuple(one.gesture.value if one.gesture else None for one, _ in with_hand),
            confidence=tuple(round(confidence, CONFIDENCE_DIGITS) for _, confidence in with_hand),
            safe_distance_m=tuple(one.distance_m for one, _ in with_hand),
            beside_px=tuple(one.beside_px for one, _ in with_hand if one.beside_px is not None),
            sources="".join(SOURCES[one.source, one.repeated] for one, _ in with_hand) if depth else "",
            bridge_m=tuple(one.bridge_m for one, _ in with_hand if one.source is DistanceSource.DEPTH),
        )
        self.number += len(self._frames)
        self._frames.clear()

    def _mark(self, reading: FrameReading) -> str:
        mark = MARKS[reading.beside_px is not None, reading.hand != self._hand]
        self._hand = reading.hand
        return mark.upper() if reading.cut_off else mark


@dataclass(slots=True)
class DecisionRecorder:
    """Records what each frame decided, after the frames that led to it."""

    scale: Scale
    _before: Report | None = None
    _frames: FrameBatch = field(default_factory=FrameBatch)

    def take(self, report: Report) -> Iterator[Body]:
        """The records of one more frame."""
        decided = tuple(records_between(self._before, report, self.scale))
        if report.reading is not None:
            self._frames.add(report.reading, report.verdict.confidence if report.verdict else 0.0)
        yield from self._frames.take(at_once=bool(decided))
        yield from decided
        self._before = report

    def end(self) -> Iterator[Body]:
        """Frames that are not recorded yet, and what was in force until the last one."""
        yield from self._frames.take(at_once=True)
        yield from records_at_end(self._before, self.scale)
        self._before = None


def records_at_end(last: Report | None, scale: Scale) -> Iterator[Body]:
    """What ends with the last frame, before the button begins anew: a press without a command, and the gesture."""
    if last is None:
        return
    button = last.button
    if button.pressed:
        button = structs.replace(
            button,
            pressed=False,
            pressed_gesture=None,
            cancel_count=button.cancel_count + 1,
            cancel_reason=PressCancel.ENDED,
        )
    ended = Verdict(gesture=None, confidence=0.0, explanation=Explanation(Decision.ENDED))
    yield from records_between(last, replace(last, gesture=None, verdict=ended, votes=0, button=button), scale)


def unpack(record: Frames, hand: int) -> Iterator[ClassifiedFrame]:
    """The frames of a record; hand: number of the hand before it.

    Raises ValueError for columns that do not fit, KeyError for marks that are none.
    """
    captures_ns = tuple(accumulate(record.after_ns, initial=record.captured_ns))
    sources = record.sources or SOURCES[DistanceSource.MONOCULAR, False] * len(record.gesture)
    fields = (record.gesture, record.confidence, record.safe_distance_m, record.beside_px, sources)
    hands = sum(PRESENT_OTHER[mark.lower()][0] for mark in record.hands)
    if any(len(column) != hands for column in fields):
        raise ValueError(hands)
    columns = zip(*fields, strict=True)
    bridges = iter(record.bridge_m)
    if len(record.bridge_m) != sum(SOURCE_OF[mark][0] is DistanceSource.DEPTH for mark in record.sources):
        raise ValueError(len(record.bridge_m))
    for mark, captured_ns in zip(record.hands, captures_ns, strict=True):
        present, other = PRESENT_OTHER[mark.lower()]
        hand += other
        if not present:
            nothing = FrameReading(
                captured_ns=captured_ns, hand=hand, gesture=None, cut_off=False, distance_m=None, beside_px=None
            )
            yield nothing, 0.0
            continue
        gesture, confidence, distance_m, beside_px, source = next(columns)
        measured, repeated = SOURCE_OF[source]
        reading = FrameReading(
            captured_ns=captured_ns,
            hand=hand,
            gesture=None if gesture is None else Gesture(gesture),
            cut_off=mark.isupper(),
            distance_m=distance_m,
            beside_px=beside_px,
            source=measured,
            bridge_m=next(bridges, None) if measured is DistanceSource.DEPTH else None,
            repeated=repeated,
        )
        yield reading, confidence
