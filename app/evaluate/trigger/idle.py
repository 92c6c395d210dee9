"""Hands that move, turn, wave and pass by without pressing: how many commands they give; it must be none.

To make 100,000 frames possible the keypoints are simulated, not detected: the digital hand's true keypoints plus
noise taken from MediaPipe, that is, from what it made of rendered frames of the same hands and gestures, frame by
frame in order, so that the noise's own persistence is kept: what it lost stays lost, and a side is named as it named
it. Enrolment, rules, vote, distance and button are the real ones.

With depth, each frame also has the map that a D435i would measure of the hand, and in a share of frames it misses it:
then the hands command by depth, and by both, as well. Frames may be left out, several together, as a busy machine
does. Every clip is drawn by its own number, so that a run that was ended goes on where it was.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct, structs
from numpy.typing import NDArray
from rich.table import Table

from app.evaluate.digital import side_of
from app.evaluate.harness import FRAME_NS, EvaluateFault, reading, table, write_whole
from app.evaluate.noise import NoiseClip, noisy_hand
from app.evaluate.trigger.chain import THRESHOLD_M, replay_pipeline
from app.evaluate.trigger.idle_moves import CLIP_FRAMES, MOVES, Move, reach_without_gesture, turn
from app.system.errors import AppError
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import Person, lens_for, person_of, posed, true_depth
from kgdfa.button_state import ButtonState
from kgdfa.distance import DistanceChoice, DistanceSource
from kgdfa.pipeline import PipelineInput
from kgdfa.preprocess import Image
from kgdfa.track import Enrolment
from logs.reading.formats import read_json

LOOK_ALIKES = ("tiger claw", "thumb up", "ok", "rest", "gun")
BLANK: Image = np.zeros((360, 640, 3), np.uint8)
SAVED_CLIPS = 25  # between two notes of the progress
# What commands: mode and source of the distance; the last two where there is depth.
CHAINS = {
    "published": ("published", DistanceChoice.MONOCULAR),
    "robust": ("robust", DistanceChoice.MONOCULAR),
    "depth": ("robust", DistanceChoice.DEPTH),
    "both": ("robust", DistanceChoice.BOTH),
}


class IdleSettings(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """holes: share of frames in which the depth map misses the hand; None: no depth.

    left_out: share of frames that no chain gets, `together` at a time, as of a camera or a machine that loses some.
    program: SHA-256 of its files, since frames of other rules make no sum; empty: kept before it was.
    """

    seed: int = 1
    threshold_m: float = THRESHOLD_M
    holes: float | None = None
    left_out: float = 0.0
    together: int = 1
    program: str = ""

    @property
    def chains(self) -> tuple[str, ...]:
        """Of CHAINS."""
        return tuple(CHAINS)[: 2 if self.holes is None else 4]


class IdleResult(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How many commands the frames gave, for each chain; presses are reported beside.

    left_out: of the frames. depth_frames: in which depth decided for `both`, the others were bridged.
    changes: of what measured, for `both`.
    """

    settings: IdleSettings
    clips: int = 0
    frames: int = 0
    left_out: int = 0
    with_hand: int = 0
    depth_frames: int = 0
    changes: int = 0
    commands: dict[str, int] = {}
    presses: dict[str, int] = {}
    cancels: dict[str, int] = {}

    @property
    def passed(self) -> bool:
        """Whether no chain of ours gave a command, and none with depth a press."""
        ours = [name for name in self.settings.chains if name != "published"]
        by_depth = [name for name in ours if name != "robust"]
        return not any(self.commands.get(name, 0) for name in ours) and not any(
            self.presses.get(name, 0) for name in by_depth
        )


def kept_progress(path: Path | None, settings: IdleSettings) -> IdleResult:
    """What an earlier run kept there. Raises AppError for no progress, or that of other settings or another program."""
    if path is None or not path.exists() or not path.stat().st_size:
        return IdleResult(settings=settings)
    with reading(path):
        kept = read_json(path, IdleResult)
    if kept.settings != settings:
        raise AppError(EvaluateFault.PROGRESS_OF_OTHERS, file=path)
    return kept


def evaluate_idle(
    clips: list[NoiseClip],
    before: IdleResult,
    *,
    frames: int,
    step: Callable[[int], None],
    keep: Path | None = None,
) -> IdleResult:
    """Simulated frames through every chain, from `before` on; step: called with the number of frames done since.

    keep: where the progress is kept. Raises AppError when it can't be.
    """
    result = before
    try:
        while result.frames < frames:
            result = _after_clip(result, clips)
            step(CLIP_FRAMES)
            if result.clips % SAVED_CLIPS == 0:
                _keep(result, keep)
    finally:
        _keep(result, keep)
    return result


def _keep(result: IdleResult, path: Path | None) -> None:
    if path is not None:
        write_whole(path, msgspec.json.encode(result))


def _after_clip(before: IdleResult, clips: list[NoiseClip]) -> IdleResult:
    """One more clip, drawn by its number."""
    settings = before.settings
    draw = np.random.default_rng([settings.seed, before.clips, 0x69646C65])
    lens, noise = lens_for(BLANK.shape[1], BLANK.shape[0]), clips[int(draw.integers(len(clips)))]
    person, move = person_of(int(draw.integers(1_000_000))), MOVES[int(draw.integers(len(MOVES)))]
    scene = posed(_gesture(draw, noise, move), person=person, lens=lens)
    camera = None if settings.holes is None else DepthCamera(before.clips, holes=settings.holes)
    chains = {
        name: replay_pipeline(
            mode, person, lens, settings.threshold_m, choice=choice, enrolment=_enrolment(mode, person)
        )
        for name, (mode, choice) in CHAINS.items()
        if name in settings.chains
    }
    last, presses = dict.fromkeys(chains, ButtonState()), dict(before.presses)
    with_hand, depth_frames, changes = before.with_hand, before.depth_frames, before.changes
    left_out = _left_out(settings, before.clips)
    for index, now in enumerate(move(draw, scene, settings.threshold_m)):
        if left_out[index]:
            continue
        hand = noisy_hand(now, noise, index)
        with_hand += hand is not None
        depth_m = None if camera is None else camera.measure(true_depth(now), index, flipping=move is turn)
        source = PipelineInput(image_bgr=BLANK, captured_ns=1_000_000_000 + index * FRAME_NS, depth_m=depth_m)
        for name, (replay, pipeline) in chains.items():
            replay.hands = (hand,) if hand else ()
            button = pipeline.process(source).button
            presses[name] = presses.get(name, 0) + (button.pressed and not last[name].pressed)
            last[name] = button
        compared = last["both"].compared if "both" in last else None
        if compared is not None and compared.distance_m is not None:
            depth_frames += compared.source is DistanceSource.DEPTH
            changes += compared.source_changed
    return structs.replace(
        before,
        clips=before.clips + 1,
        frames=before.frames + CLIP_FRAMES,
        left_out=before.left_out + int(left_out.sum()),
        with_hand=with_hand,
        depth_frames=depth_frames,
        changes=changes,
        presses=presses,
        commands={name: before.commands.get(name, 0) + one.release_count for name, one in last.items()},
        cancels={name: before.cancels.get(name, 0) + one.cancel_count for name, one in last.items()},
    )


def _left_out(settings: IdleSettings, clip: int) -> NDArray[np.bool_]:
    """Which frames of a clip are: by draws of their own, so that its hands and moves are the same without."""
    draw = np.random.default_rng([settings.seed, clip, 0x6C656674])
    groups = draw.random(math.ceil(CLIP_FRAMES / settings.together)) < settings.left_out
    return np.repeat(groups, settings.together)[:CLIP_FRAMES]


def _enrolment(mode: str, person: Person) -> Enrolment | None:
    """As a session enrols the patient's hand; the paper's rule knows nobody."""
    return None if mode == "published" else Enrolment(side=side_of(person))


def _gesture(draw: np.random.Generator, noise: NoiseClip, move: Move) -> str:
    """The gesture that the noise was taken from; a look-alike where a gesture would make it a press."""
    return str(draw.choice(LOOK_ALIKES)) if move is reach_without_gesture else noise.gesture


def idle_table(result: IdleResult) -> Table:
    """Commands of hands that pressed nothing."""
    rows = [
        (name, result.commands.get(name, 0), result.presses.get(name, 0), result.cancels.get(name, 0))
        for name in result.settings.chains
    ]
    values = {"frames": f"{result.frames:,}", "left_out": f"{result.left_out:,}"}
    columns = "empty commands presses cancelled"
    if result.settings.left_out:
        return table("idle.left_out", columns, rows, left=4, **values)
    return table("idle", columns, rows, left=4, **values)
