"""rleex evaluate: voice."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.common import MAX_SEED, Json, check_output_folder, shown_after
from app.cli.evaluate.common import progress
from app.evaluate.harness import require_extra, write_json
from app.evaluate.voice.speech import Voices
from app.text.catalogue import tr

cli = typer.Typer()


@cli.command()
def voice(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder with recordings.csv (path,stop,group) and WAV files.")
    ] = None,
    voices: Annotated[Voices, typer.Option(help="Synthetic speech: which half of the voices.")] = Voices.HELD_OUT,
    minutes: Annotated[int, typer.Option(help="Minutes of each noise without the word.", min=1, max=6000)] = 20,
    seed: Annotated[int, typer.Option(help="Another seed, other mixtures.", min=0, max=MAX_SEED)] = 1,
    keep: Annotated[
        Path | None,
        typer.Option(callback=check_output_folder, help="Keep the synthetic recordings in this folder."),
    ] = None,
    json_file: Json = None,
) -> None:
    """How often "stop" and 停 stop, and what else does, on recordings; without a folder on synthetic speech."""
    require_extra("voice", "pocketsphinx")
    from app.evaluate.voice import recordings as made
    from app.evaluate.voice.recordings import as_json, measure, tables
    from app.evaluate.voice.speech import require_speech
    from app.voice.spotter import KeywordSpotter

    if folder is None:
        require_speech()
        found, total = made.synthetic(voices, minutes, seed), made.synthetic_count(minutes)
        if keep is not None:
            keep.mkdir(parents=True, exist_ok=True)
            found = made.keep(found, keep)
    else:
        listed = made.read_recordings(folder)
        found, total = iter(listed), len(listed)
    with progress("listening", total) as step:
        results = measure(found, KeywordSpotter(), step)
    lines = [] if folder else [tr("evaluate.voice.synthetic", voices=voices.value)]
    with shown_after([*tables(results), *lines]):
        write_json(as_json(results), json_file)
