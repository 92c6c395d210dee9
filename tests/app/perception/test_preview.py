"""The image for the screen: at its rate, never larger than asked, and pausable."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

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


@given(width=st.integers(16, 1280), wanted=st.integers(8, 320), at=st.floats(0.1, 0.9))
def test_what_is_drawn_is_where_it_is_on_the_image(width: int, wanted: int, at: float) -> None:
    """A place that perception names by the image's pixels is drawn at the same share of the preview."""
    image = np.zeros((width, width, 3), np.uint8)

    def dot(picture: NDArray[np.uint8], scale: float) -> None:
        picture[round(at * width * scale), round(at * width * scale)] = 255

    message = PreviewPacer(width_px=wanted).message(image, 1, dot)
    pixels = np.frombuffer(message.rgb, np.uint8).reshape(message.height_px, message.width_px, 3)
    y, x, _ = np.unravel_index(pixels.argmax(), pixels.shape)
    assert abs(x - at * message.width_px) <= 1.5
    assert abs(y - at * message.height_px) <= 1.5
    assert not image.any()  # the frame itself stays as it came


@given(grey=st.integers(0, 255), width=st.integers(2, 1280))
def test_a_plain_picture_stays_plain(grey: int, width: int) -> None:
    message = PreviewPacer(width_px=120).message(np.full((width, width, 3), grey, np.uint8), 1)
    assert set(message.rgb) == {grey}
