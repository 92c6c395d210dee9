"""The distance on the screen is the one by which the button decides, and its mark is where a press happens."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from app.console.widgets.gesture import _figure, gauge
from app.ipc.messages import TriggerReport
from app.perception.reporting import with_report
from hal.minimum_jerk import minimum_jerk
from kgdfa.button_state import ButtonPlace
from kgdfa.gesture import Gesture
from kgdfa.pipeline import Pipeline, PipelineInput, Report
from kgdfa.published import PublishedRules
from kgdfa.robust_distance import RobustRange
from testing.messages import without_hand
from tests.app.console.conftest import Opener
from tests.support.live_session import BLACK, FRAME_NS, Shown, hand_at

WIDTH = 60
Frame = tuple[Report, TriggerReport]


def pushed(focal_px: float, reference_m: float, threshold_m: float) -> list[Frame]:
    """A push from 1.9 thresholds to 0.75 and back, by a hand and a camera of that scale."""
    shown = Shown()
    place = ButtonPlace.in_the_middle(1280, 720, threshold_m)
    finder = RobustRange(focal_px=focal_px, reference_m=reference_m)
    pipeline = Pipeline(detector=shown, rules=PublishedRules(), range_finder=finder, place=place)
    shares = [0.0] * 8 + [float(minimum_jerk(np.array(count / 12))) for count in range(13)]
    found = []
    for count, share in enumerate([*shares, *reversed(shares)], 1):
        distance_m = threshold_m * (1.9 - 1.15 * share)
        drawn_m = distance_m * (650.0 * 0.065) / (focal_px * reference_m)  # `hand_at` draws that camera's hand
        shown.hands = (hand_at(Gesture.FIVE, drawn_m),)
        now_ns = count * FRAME_NS
        report = pipeline.process(PipelineInput(image_bgr=BLACK, captured_ns=now_ns))
        found.append((report, with_report(without_hand(now_ns, count, threshold_m), report)))
    return found


def figure_cm(message: TriggerReport) -> float:
    """The one in bold."""
    (text,) = (part for part, style in _figure(message, WIDTH) if style == "bold")
    return float(text.removesuffix("cm  "))


def line(message: TriggerReport, width: int = WIDTH) -> str:
    """The gauge of a message."""
    safe_m, sd_m = message.safe_distance_m, message.distance_sd_m
    return gauge(safe_m, sd_m, message.threshold_m, width, best_m=message.distance_m)


@pytest.mark.parametrize(("focal_px", "reference_m"), [(650.0, 0.065), (900.0, 0.078), (560.0, 0.05)])
@pytest.mark.parametrize("threshold_m", [0.20, 0.235])
def test_the_figure_and_the_mark_are_the_buttons(focal_px: float, reference_m: float, threshold_m: float) -> None:
    frames = pushed(focal_px, reference_m, threshold_m)
    for report, message in frames:
        compared = report.button.compared
        assert compared is not None
        assert compared.distance_m is not None
        assert (message.safe_distance_m, message.threshold_m) == (compared.distance_m, compared.threshold_m)
        near = compared.distance_m < compared.threshold_m
        assert figure_cm(message) == pytest.approx(100 * compared.distance_m, abs=0.1)
        assert (figure_cm(message) < 100 * threshold_m) is near
        text = line(message)
        assert (text.index("●") < text.index("┃")) is near
    pressed = [report.button.pressed for report, _ in frames]
    at = pressed.index(True)
    assert figure_cm(frames[at - 1][1]) >= 100 * threshold_m > figure_cm(frames[at][1])


def test_a_best_guess_under_the_threshold_is_small_and_presses_nothing() -> None:
    _, resting = pushed(650.0, 0.065, 0.20)[0]
    message = replace(resting, safe_distance_m=0.2004, distance_m=0.19)
    assert figure_cm(message) == 20.1
    assert "best guess 19.0" in "".join(part for part, style in _figure(message, WIDTH) if style == "$foreground-muted")
    assert line(message).index("░") < line(message).index("┃")


async def test_the_screen_shows_the_buttons_numbers(console: Opener) -> None:
    frames = pushed(650.0, 0.065, 0.20)
    at = next(place for place, (report, _) in enumerate(frames) if report.button.pressed)
    async with console() as opened:
        for place in (at - 8, at - 1, at):
            report, message = frames[place]
            assert report.button.compared is not None
            opened.host.message = message
            await opened.shows(f"{figure_cm(message):.1f} cm  press under 20 cm")
            await opened.shows("PRESSED" if message.pressed else "RELEASED")
            assert ("▼" in opened.text()) is message.pressed
