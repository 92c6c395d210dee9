"""rleex run, rleex demo, rleex joints: the therapist's console; all actions without a terminal, by the digital hand;
the exoskeleton's own computer, headless, for a therapist's laptop that is paired with it.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Annotated

import typer

from app.cli.common import (
    MAX_SEED,
    PORT,
    HomeOption,
    check_finite,
    check_output,
    check_terminal,
    print_text,
    refuse_options,
    shown_after,
    spinner,
    wide_console,
)
from app.system.config import CameraKind, JointsKind, load_config, with_choices
from app.system.paths import Home, find_home, hold_home
from profiles.schema import DistanceUsed

cli = typer.Typer()

PRESSES = 3  # attempts a press: one that had no effect is repeated, as people do


@contextmanager
def no_collections() -> Iterator[None]:
    """No garbage collection while modules load, which leave none: saves 0.07 s."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@cli.command()
def run(
    home: HomeOption = None,
    patient: Annotated[str | None, typer.Option(help="Go straight to this patient.")] = None,
    camera: Annotated[CameraKind | None, typer.Option(help="Another camera than the configuration's.")] = None,
    joints: Annotated[JointsKind | None, typer.Option(help="Other joints than the configuration's.")] = None,
    read_only: Annotated[bool, typer.Option("--read-only", help="Read only: change nothing.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="More in the logs for engineers.")] = False,
    serve: Annotated[bool, typer.Option("--serve", help="Watch in a browser on this machine, read-only.")] = False,
    plain: Annotated[
        bool, typer.Option("--plain", help="Follow a session in lines of text, for screen readers; read-only.")
    ] = False,
) -> None:
    """Open the therapist's console."""
    if watches := "--serve" if serve else "--plain" if plain else "--read-only" if read_only else "":
        others = {"--plain": serve and plain, "--patient": patient, "--camera": camera, "--joints": joints}
        refuse_options(f"run {watches}", others)
    from app.system.diagnostics_log import set_verbose, start_log

    place = find_home(home)
    if verbose:
        set_verbose()
    config = with_choices(load_config(place.config), camera=camera, joints=joints, patient=patient)
    if serve:
        from app.console.observer import serve_console

        serve_console(place)
        return
    if plain:
        from app.console.observer import speak_session

        with suppress(KeyboardInterrupt):
            speak_session(place, typer.echo)
        return
    check_terminal()
    if patient is not None and config.joints.host and not read_only:
        from app.link.questions import require_joints

        require_joints(place, config.joints.host)
    with no_collections():
        from app.console.run import run_console
    from app.session.shared import held_session
    from app.system.hand_model import set_up_model
    from app.system.legs_lock import check_legs_free

    if read_only:
        run_console(place, config, read_only=True)
        return
    with hold_home(place):
        if held_session(place) is None:  # else it is taken over
            check_legs_free(place)
        start_log(place, "console")
        set_up_model(place, config)
        run_console(place, config, straight=patient is not None)


@cli.command()
def demo(
    seed: Annotated[
        int, typer.Option(min=0, max=MAX_SEED, help="Which hand: tone, palm width, light, background.")
    ] = 1,
    joints: Annotated[JointsKind, typer.Option(help="can: emulated drives on a bus.")] = "simulated",
    json_file: Annotated[
        Path | None, typer.Option("--json", callback=check_output, help="Write the result here as well.")
    ] = None,
    click: Annotated[
        float, typer.Option(callback=check_finite, help="Seconds to press and withdraw.", min=0.2, max=3.0)
    ] = 0.6,
    record: Annotated[bool, typer.Option("--record", help="Record it: one MCAP file beside its trail.")] = False,
    pictures: Annotated[
        bool, typer.Option("--pictures", help="Record the camera's pictures as well, in a file of their own.")
    ] = False,
    distance: Annotated[
        DistanceUsed, typer.Option(help="Which distance commands; both: depth, its holes bridged by the keypoints.")
    ] = DistanceUsed.MONOCULAR,
    patient: Annotated[
        str,
        typer.Option(help="Whose legs and vocabulary; the hand is the digital one. Empty: the demo patient."),
    ] = "",
    two_hosts: Annotated[
        bool,
        typer.Option("--two-hosts", help="Run both computers here: the joints in a second process, over the link."),
    ] = False,
    load: Annotated[int, typer.Option(min=0, max=64, help="Busy processes to start beside it.")] = 0,
    home: HomeOption = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log more for engineers.")] = False,
) -> None:
    """Run all twelve actions by gestures with the real processes; exit status 0 only if all pass.

    What the patient's vocabulary lacks is done by key.
    """
    from tempfile import TemporaryDirectory

    from app.demo.drives import busy_processes, joints_for
    from app.demo.scenario import ALL_TWELVE
    from app.demo.session import demo_config, demo_patient, print_result, run_session
    from app.demo.two_hosts import second_computer
    from app.evaluate.harness import write_json
    from app.system.diagnostics_log import set_verbose, start_log
    from app.system.hand_model import set_up_model
    from app.system.legs_lock import check_legs_free
    from app.system.scheduling import set_scheduling
    from profiles.schema import DEMO_PATIENT
    from profiles.store import ProfileStore

    record = record or pictures
    console = wide_console()
    place = find_home(home)
    if verbose:
        set_verbose()
    base = load_config(place.config)
    wearer = demo_patient(seed, distance, ProfileStore(place.profiles).load(patient) if patient else DEMO_PATIENT)
    with hold_home(place), joints_for(joints, base, wearer) as joints_config, ExitStack() as stack:
        check_legs_free(place)
        start_log(place, "demo")
        set_scheduling("console")  # in whose place it is
        set_up_model(place, base)
        config = demo_config(base, seed=seed, joints=joints_config, record=record)
        other = None
        if two_hosts:
            other = Home(Path(stack.enter_context(TemporaryDirectory(prefix="rleex-joints-"))))
            config = stack.enter_context(second_computer(place, other, config))
        with busy_processes(load), spinner(console, total=len(ALL_TWELVE)) as watch:
            result = run_session(
                place,
                config,
                ALL_TWELVE,
                click_s=click,
                presses=PRESSES,
                watch=watch,
                load=load,
                pictures=pictures,
                patient=wearer,
                other=other,
            )

    def print_all() -> None:
        print_result(console, result, ALL_TWELVE)
        if record:
            _print_recorded(place.logs, result.session)

    with shown_after(print_all):
        write_json(result.as_json(ALL_TWELVE), json_file)
    raise typer.Exit(0 if result.passed(ALL_TWELVE) else 1)


def _print_recorded(logs: Path, session: str) -> None:
    """Each file of a session's recording, and what a full or slow disk cost it."""
    from app.text.recorded import render_recorded
    from logs.read import records
    from logs.reason import Reason
    from logs.records import RecordingFile

    for record in records(logs / f"{session}.jsonl"):
        one = record.body
        if not isinstance(one, RecordingFile):
            continue
        print_text("recording.written", path=logs / one.file)
        if one.lost or one.fault:
            why = render_recorded(one.fault) if isinstance(one.fault, Reason) else one.fault or ""
            print_text("recording.lost_messages", messages=sum(one.lost.values()), file=one.file, why=why)


@cli.command()
def joints(
    home: HomeOption = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="TCP and UDP port.")] = PORT,
    print_service: Annotated[
        bool, typer.Option("--print-service", help="Print a systemd service file for this command and end.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log more for engineers.")] = False,
) -> None:
    """Run on the exoskeleton's computer: control, guardian, planner and drives for a paired laptop's console."""
    place = find_home(home)
    if print_service:
        from app.link.service import service_file

        typer.echo(service_file(place, port), nl=False)
        return
    from app.link.service import serve_joints
    from app.system.diagnostics_log import set_verbose, start_log

    if verbose:
        set_verbose()
    with hold_home(place):
        start_log(place, "joints")
        serve_joints(place, port, lambda _: print_text("cli.joints.ready", port=port, home=place.root))
