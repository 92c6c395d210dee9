"""rleex replay: a recorded session as a film."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from app.cli.common import HomeOption, check_finite, check_output, print_text

cli = typer.Typer()


@cli.command("replay")
def replay_recording(
    file: Annotated[
        str, typer.Argument(help="A recording, or a session: name, beginning of a name, or last.")
    ] = "last",
    film_file: Annotated[
        Path | None, typer.Option("--film", callback=check_output, help="The MP4 to write; else SESSION.mp4.")
    ] = None,
    from_s: Annotated[
        float | None, typer.Option("--from", callback=check_finite, help="Seconds from the beginning, or the event.")
    ] = None,
    to_s: Annotated[
        float | None, typer.Option("--to", callback=check_finite, help="Seconds from the beginning, or the event.")
    ] = None,
    speed: Annotated[
        float, typer.Option(callback=check_finite, help="Recorded seconds in a second of film.", min=0.05, max=50)
    ] = 1.0,
    event: Annotated[
        str, typer.Option(help="Begin at this record: its number, or the first of an event or a kind by name.")
    ] = "",
    home: HomeOption = None,
) -> None:
    """Make a film of a recording: hand, legs, joints, distance, gait and events on one time axis."""
    from app.cli.progress import bar, wide_console
    from app.playback.film import film, stretch_of
    from app.playback.session import Playback
    from app.recording.read import find_recording
    from app.system.paths import find_home

    with closing(Playback(find_recording(find_home(home).logs, file))) as playback:
        target = film_file or check_output(Path(f"{playback.name}.mp4"))
        assert target is not None
        stretch = stretch_of(playback, from_s, to_s, event, speed)
        try:
            with bar(wide_console(), target.name, stretch.frames) as step:
                frames = film(playback, target, stretch, step)
        except KeyboardInterrupt:
            print_text("film.stopped", path=target)
            raise typer.Exit(130) from None
        print_text("film.written", path=target, frames=frames, from_s=stretch.from_s, to_s=stretch.to_s)
        if playback.index.cut:
            print_text("film.cut", path=playback.path)
        if playback.index.damaged_chunks:
            print_text("film.damaged", path=playback.path, chunks=len(playback.index.damaged_chunks))
