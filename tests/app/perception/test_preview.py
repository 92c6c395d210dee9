"""The image for the screen: at its rate, never larger than asked, and pausable."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.ipc.messages import PerceptionCommand
from app.perception.reporting import PreviewPacer


@given(rate_hz=st.floats(1, 25), camera_hz=st.sampled_from([15, 30, 60]))
def test_images_come_at_about_the_rate_asked_for(rate_hz: float, camera_hz: int) -> None:
    pacer = PreviewPacer(rate_hz=rate_hz)
    sent = sum(pacer.due(1 + round(frame * 1e9 / camera_hz)) for frame in range(camera_hz * 10))
    assert sent <= 10 * rate_hz * 1.05 + 2
    assert sent >= 10 * min(rate_hz, camera_hz) * 0.6


def test_rate_zero_pauses() -> None:
    pacer = PreviewPacer()
    pacer.configure(PerceptionCommand(preview_hz=0.0))
    assert not any(pacer.due(t * 10**8) for t in range(100))


@given(width=st.integers(2, 64), height=st.integers(2, 64), wanted=st.integers(2, 200))
def test_image_has_as_many_bytes_as_stated_and_never_grows(width: int, height: int, wanted: int) -> None:
    pacer = PreviewPacer(width_px=wanted)
    message = pacer.message(np.zeros((height, width, 3), np.uint8), 1)
    assert len(message.rgb) == message.width_px * message.height_px * 3
    assert message.width_px <= max(2, min(width, wanted))


def test_colours_arrive_as_rgb() -> None:
    blue_bgr = np.zeros((2, 2, 3), np.uint8)
    blue_bgr[:, :, 0] = 255
    assert PreviewPacer().message(blue_bgr, 1).rgb[:3] == b"\x00\x00\xff"
