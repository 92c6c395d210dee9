"""rleex simulate: rehearse actions on the simulated exoskeleton."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

cli = typer.Typer()


@cli.command()
def simulate(
    action: Annotated[str, typer.Argument(help="An action's name (walk, stair-up, ...), `all`, or `corners`.")],
    profile: Annotated[str, typer.Option("--profile", "-p", help="Patient: identifier or path of a TOML.")] = "demo",
    gait: Annotated[Path | None, typer.Option(help="Folder of normative gait curves, for `walk`.")] = None,
    plot_file: Annotated[Path | None, typer.Option("--plot", help="Write angles, torques and paths as PNG.")] = None,
    video: Annotated[Path | None, typer.Option(help="Write a stick-figure film, MP4.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")] = None,
    preflight: Annotated[bool, typer.Option(help="Keep the verdicts as this patient's pre-flight.")] = False,
    home: Annotated[Path | None, typer.Option(help="Data directory.")] = None,
) -> None:
    """Rehearse an action in simulation through planner, follower and guard; exit status 1 when it does not pass."""
    import json

    import msgspec
    from rich.console import Console

    from app.cli.progress import bar, wide_console
    from app.config import load_config
    from app.control.patient import patient_of
    from app.control.preflight import keep_verdict
    from app.control.rehearsal import rehearse
    from app.evaluate.simulate import actions_named, corners, likeness, profile_named, read_norm, verdict_table
    from app.evaluate.simulate_plot import film, plot
    from app.paths import find_home
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton

    console: Console = wide_console()
    place = find_home(home)
    config = load_config(place.config)
    device = load_exoskeleton(Path(config.joints.device) if config.joints.device else DEFAULT_DEVICE)
    norm = read_norm(gait) if gait is not None else None
    if action == "corners":
        with bar(console, "corners", 48) as step:
            rows = corners(device, lambda _: step())
    else:
        wearer = profile_named(place, profile)
        patient = patient_of(wearer, device)
        rows = []
        wanted = actions_named(action)
        with bar(console, wearer.identifier, len(wanted)) as step:
            for one in wanted:
                shown = rehearse(patient, device, one)
                rows.append((wearer, shown.verdict))
                if preflight:
                    keep_verdict(place, patient, device, one, shown.verdict)
                if plot_file is not None:
                    plot(shown, named(plot_file, one.name, many=len(wanted) > 1), norm)
                if video is not None:
                    film(shown, patient.body, named(video, one.name, many=len(wanted) > 1))
                if norm is not None and len(shown.starts) > 4:
                    console.print(f"{one.value}: likeness to the very slow gait {likeness(shown, norm)}")
                step()
    console.print(verdict_table(rows))
    if json_file is not None:
        built = [{"patient": who.identifier, **msgspec.to_builtins(verdict)} for who, verdict in rows]
        json_file.write_text(json.dumps(built, indent=1) + "\n", encoding="utf-8")
    if not all(verdict.passed for _, verdict in rows):
        raise typer.Exit(1)


def named(file: Path, action: str, *, many: bool) -> Path:
    """The file for one action of several."""
    return file.with_stem(f"{file.stem}-{action.lower().replace('_', '-')}") if many else file
