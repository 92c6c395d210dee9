"""rleex evaluate: voice."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.common import MAX_SEED, Json, check_output_folder, refuse_options, shown_after
from app.cli.evaluate.common import progress
from app.evaluate.harness import write_json
from app.evaluate.voice.speech import Voices
from app.text.catalogue import tr

cli = typer.Typer()
MINUTES, SEED = 20, 1  # of synthetic speech


@cli.command()
def voice(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder with recordings.csv (path,stop,group) and WAV files.")
    ] = None,
    voices: Annotated[Voices, typer.Option(help="Synthetic speech: which half of the voices.")] = Voices.HELD_OUT,
    minutes: Annotated[int, typer.Option(help="Minutes of each noise without the word.", min=1, max=6000)] = MINUTES,
    seed: Annotated[int, typer.Option(help="Another seed, other mixtures.", min=0, max=MAX_SEED)] = SEED,
    keep: Annotated[
        Path | None,
        typer.Option(callback=check_output_folder, help="Keep the synthetic recordings in this folder."),
    ] = None,
    json_file: Json = None,
) -> None:
    """How often "stop" and 停 stop, and what else does, on recordings; without a folder on synthetic speech."""
    if folder is not None:
        synthetic = {"--voices": voices is not Voices.HELD_OUT, "--minutes": minutes != MINUTES}
        refuse_options("evaluate voice DIR", synthetic | {"--seed": seed != SEED, "--keep": keep})
    from app.evaluate.voice import recordings as made
    from app.evaluate.voice.recordings import as_json, measure, tables
    from app.evaluate.voice.speech import require_speech
    from app.voice.spotter import KeywordSpotter, require_spotter

    require_spotter()
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
