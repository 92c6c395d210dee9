"""A film shows the stretch that was asked for, at 25 frames a second; one that ends early leaves nothing."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.playback import frame, pen
from app.playback.film import LEAD_S, FilmFault, Stretch, film, stretch_of, view_at, whole_of, write_film
from app.playback.frame import HEIGHT_PX, WIDTH_PX
from app.playback.session import Playback, ReplayFault, moment_ns
from app.playback.view import Legs, clock
from app.recording.read import RecordingReadFault
from app.recording.schemas import TOPICS
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from app.text.catalogue import languages, use_language
from logs import records as r
from tests.support.disks import full_disk
from tests.support.recorded_session import Lived


def frames_of(path: Path) -> tuple[int, float, tuple[int, int]]:
    """Count, rate, size; every frame is decoded."""
    reader = cv2.VideoCapture(str(path))
    rate, count, size = reader.get(cv2.CAP_PROP_FPS), 0, (0, 0)
    while (found := reader.read())[0]:
        count, size = count + 1, (found[1].shape[1], found[1].shape[0])
    reader.release()
    return count, rate, size


@pytest.mark.parametrize(
    ("seconds", "digits", "shown"),
    [
        (119.6, 0, "2:00"),
        (59.996, 2, "1:00.00"),
        (119.4, 0, "1:59"),
        (59.994, 2, "0:59.99"),
        (0.0, 2, "0:00.00"),
        (3661.25, 1, "61:01.2"),
    ],
)
def test_a_clock_has_no_sixtieth_second(seconds: float, digits: int, shown: str) -> None:
    assert clock(seconds, digits) == shown


@pytest.mark.parametrize(("speed", "frames"), [(1.0, 26), (2.0, 13), (0.5, 51)])
def test_it_lasts_as_long_as_the_stretch_over_the_speed(
    playback: Playback, tmp_path: Path, speed: float, frames: int
) -> None:
    target, steps = tmp_path / "out.mp4", []
    stretch = stretch_of(playback, 3.0, 4.0, speed=speed)
    assert film(playback, target, stretch, lambda: steps.append(1)) == frames == len(steps)
    assert frames_of(target) == (frames, 25.0, (WIDTH_PX, HEIGHT_PX))
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]


def test_an_event_begins_shortly_before_its_moment(playback: Playback) -> None:
    stop = playback.find("stop")
    at_s = playback.seconds(moment_ns(stop))
    stretch = stretch_of(playback, None, 0.1, "stop")
    assert (stretch.from_s, stretch.to_s) == (at_s - LEAD_S, at_s + 0.1)
    assert stretch_of(playback, 0.05, None, str(stop.sequence)) == Stretch(from_s=at_s + 0.05, to_s=playback.duration_s)


@pytest.mark.parametrize(("from_s", "to_s"), [(1e6, None), (3.0, 3.0), (5.0, 4.0), (None, -1.0)])
def test_times_without_anything_are_refused(playback: Playback, from_s: float | None, to_s: float | None) -> None:
    with pytest.raises(AppError) as caught:
        stretch_of(playback, from_s, to_s)
    assert caught.value.code is ReplayFault.NO_SUCH_TIME


def test_a_name_with_a_colon_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_film(Path("10:30.mp4"), [np.zeros((48, 64, 3), np.uint8)] * 3, frames=3, fps=25, size_px=(64, 48))
    assert frames_of(tmp_path / "10:30.mp4") == (3, 25.0, (64, 48))


def test_a_stopped_film_leaves_nothing(playback: Playback, tmp_path: Path) -> None:
    steps: list[int] = []

    def stop() -> None:
        steps.append(1)
        if len(steps) == 5:
            raise KeyboardInterrupt

    target = tmp_path / "out.mp4"
    target.write_bytes(b"an older film")
    with pytest.raises(KeyboardInterrupt):
        film(playback, target, stretch_of(playback, 0.0, 2.0), stop)
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]
    assert target.read_bytes() == b"an older film"


def test_a_disk_that_fills_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    room, images = iter([1 << 40, 1 << 20]), [np.zeros((48, 64, 3), np.uint8)] * 75
    with pytest.raises(AppError) as caught:
        write_film(tmp_path / "out.mp4", images, frames=75, fps=25, size_px=(64, 48), free_bytes=lambda _: next(room))
    assert caught.value.code is FilmFault.DISK_FULL
    assert not list(tmp_path.iterdir())


def test_a_film_that_did_not_reach_the_disk_is_reported(playback: Playback, tmp_path: Path) -> None:
    with full_disk(20_000), pytest.raises(AppError) as caught:
        film(playback, tmp_path / "out.mp4", stretch_of(playback, 3.0, 5.0), lambda: None)
    assert caught.value.code is FilmFault.NOT_WHOLE
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("language", languages())
def test_every_moment_can_be_drawn_in_every_language(playback: Playback, language: str) -> None:
    legs, whole = Legs(playback, playback.wearer()), whole_of(playback, 2.0)
    use_language(language)
    try:
        drawn = [
            frame.draw(view_at(playback, legs, at_ns), whole)
            for at_ns in (playback.begin_ns - 1, *range(playback.begin_ns, playback.end_ns + 1, 700_000_000))
        ]
    finally:
        use_language("en")
    assert {image.shape for image in drawn} == {(HEIGHT_PX, WIDTH_PX, 3)}
    within = drawn[1:]  # just before its beginning it looks as at its beginning
    assert len({image.tobytes() for image in within}) == len(within)


def test_the_mark_of_the_press_stands_where_the_distance_was(playback: Playback) -> None:
    press = next(one for one in playback.records if isinstance(one.body, r.Press))
    view = view_at(playback, Legs(playback, playback.wearer()), moment_ns(press))
    assert [(at_ns, record.sequence) for at_ns, record in view.pushes] == [(moment_ns(press), press.sequence)]
    part = frame.PUSH
    graph = frame.draw(view, whole_of(playback, 1.0))[part.y : part.bottom, part.right - 30 : part.right]
    assert np.any(np.all(graph == pen.GOOD, axis=2))


def test_after_a_jump_the_legs_stand_as_if_it_had_been_played(playback: Playback) -> None:
    """The foot that carries, and how far the other is from it."""
    ended = next(one for one in playback.records if isinstance(one.body, r.ActionEnd) and one.body.steps)
    assert isinstance(ended.body, r.ActionEnd)
    wearer = playback.wearer()
    played, at_ns = Legs(playback, wearer), (ended.body.accepted_ns + ended.body.ended_ns) // 2
    for now_ns in range(ended.body.accepted_ns - 400_000_000, at_ns, 40_000_000):
        view_at(playback, played, now_ns)
    one = view_at(playback, played, at_ns).legs
    other = view_at(playback, Legs(playback, wearer), at_ns).legs
    assert one is not None
    assert other is not None
    assert one.pose.carries == other.pose.carries
    apart = [pose.ankles[0][0] - pose.ankles[1][0] for pose in (one.pose, other.pose)]
    assert apart[0] == pytest.approx(apart[1], abs=0.002)


def test_the_command_films_and_names_what_it_refuses(session: Lived, tmp_path: Path) -> None:
    target = tmp_path / "film.mp4"
    options = ["--film", str(target), "--event", "release", "--from", "0", "--to", "0.4"]
    done = CliRunner().invoke(cli, ["replay", session.path.stem, "--home", str(session.path.parent.parent), *options])
    assert done.exit_code == 0, done.output
    assert "11 frames" in done.output
    assert frames_of(target)[0] == 11
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(session.path.read_bytes()[:-3000])
    done = CliRunner().invoke(cli, ["replay", str(cut), "--film", str(target), "--to", "0.2"])
    assert "was cut off" in done.output, done.output
    empty, newer = tmp_path / "empty.mcap", tmp_path / "newer.mcap"
    RecordingWriter(empty, TOPICS, 0).finish()
    newer.write_bytes(session.path.read_bytes().replace(b"rleex-recording 1", b"rleex-recording 9", 1))
    for path, more, fault in (
        (empty, [], RecordingReadFault.EMPTY),
        (newer, [], RecordingReadFault.NEWER),
        (tmp_path / "none.mcap", [], RecordingReadFault.UNREADABLE),
        (session.path, ["--event", "flying"], ReplayFault.NO_SUCH_RECORD),
        (session.path, ["--from", "1000"], ReplayFault.NO_SUCH_TIME),
    ):
        with pytest.raises(AppError) as caught:
            CliRunner().invoke(cli, ["replay", str(path), "--film", str(target), *more], catch_exceptions=False)
        assert caught.value.code is fault


def test_an_unwritable_format_is_reported(playback: Playback, tmp_path: Path) -> None:
    with pytest.raises(AppError) as caught:
        film(playback, tmp_path / "out.txt", stretch_of(playback, 0.0, 1.0), lambda: None)
    assert caught.value.code is FilmFault.NO_FORMAT
