"""Hands that move, turn, wave and pass by without pressing: how many commands they give; it must be none.

To make 100,000 frames possible the keypoints are simulated, not detected: the digital hand's true keypoints plus
noise taken from MediaPipe, that is, from what it made of rendered frames of the same hands and gestures, frame by
frame in order, so that the noise's own persistence is kept. Rules, vote, distance and button are the real ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from rich.table import Table

from app.evaluate.digital import HEIGHT_M, smooth, take, tilted, walk
from app.evaluate.harness import FRAME_NS, Step, table
from app.evaluate.noise import residual, with_noise
from app.evaluate.readings import GESTURE_NAMES
from app.evaluate.trigger.table6 import MODES, THRESHOLD_M, replay_pipeline
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.render import Scene, lens_for, person_of, posed
from kgdfa.button import ButtonState
from kgdfa.hand import FloatArray, Hand
from kgdfa.keypoints import HandDetector
from kgdfa.pipeline import PipelineInput
from kgdfa.preprocess import Image

CLIP_FRAMES = 90
NOISE_WALKS = 36
NOISE_FRAMES = 24
FIRST_HAND = 5_001
LOOK_ALIKES = ("tiger claw", "thumb up", "ok", "rest", "gun")
CLEAR_M = (
    THRESHOLD_M + 0.03
)  # a hand that does not press stays this far away, or beside the button, or gives no gesture
BLANK: Image = np.zeros((720, 1280, 3), np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseClip:
    """What MediaPipe made of one walk, less the truth: per frame, (n, 21, 2) on the image, (n, 21, 3) in space."""

    gesture: str
    image: FloatArray
    world: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class IdleResult:
    """How many commands the frames gave, a mode; presses are reported beside, none of which became a command."""

    frames: int
    noise_frames: int
    commands: dict[str, int]
    presses: dict[str, int]
    cancels: dict[str, int]


def take_noise(detector: HandDetector, step: Step) -> list[NoiseClip]:
    """Detect hands on rendered walks and keep how the keypoints differ from the truth."""
    lens, now_ns, clips = lens_for(), 1_000_000_000, []
    for number in range(NOISE_WALKS):
        seed, gesture = FIRST_HAND + number, GESTURE_NAMES[number % 12]
        person = person_of(seed)
        rows = []
        now_ns += 1_000_000_000
        for index, moment in enumerate(walk(gesture, person=person, lens=lens, seed=seed, frames=NOISE_FRAMES)):
            now_ns += FRAME_NS
            hands = detector.detect(take(moment, index)[0], now_ns)
            if hands:
                rows.append(residual(hands[0], moment.scene))
            step()
        if rows:
            image, world = (np.array(part) for part in zip(*rows, strict=True))
            clips.append(NoiseClip(gesture=gesture, image=image, world=world))
    return clips


def evaluate_idle(clips: list[NoiseClip], *, frames: int, seed: int, step: Callable[[int], None]) -> IdleResult:
    """Simulated frames through both modes. `step` is called with the number of frames done since the last call."""
    draw, lens = np.random.default_rng([seed, 0x69646C65]), lens_for()
    totals = {what: dict.fromkeys(MODES, 0) for what in ("commands", "presses", "cancels")}
    done, now_ns = 0, 1_000_000_000
    while done < frames:
        noise = clips[int(draw.integers(len(clips)))]
        person = person_of(int(draw.integers(1_000_000)))
        chains = {mode: replay_pipeline(mode, person, lens) for mode in MODES}
        last = dict.fromkeys(MODES, ButtonState())
        move = MOVES[int(draw.integers(len(MOVES)))]
        for index, scene in enumerate(move(draw, posed(_gesture(draw, noise, move), person=person, lens=lens))):
            now_ns += FRAME_NS
            hand = _noisy(scene, noise, index)
            for mode, (replay, pipeline) in chains.items():
                replay.hands = (hand,) if hand else ()
                button = pipeline.process(PipelineInput(image_bgr=BLANK, captured_ns=now_ns)).button
                totals["presses"][mode] += button.pressed and not last[mode].pressed
                last[mode] = button
        for mode, button in last.items():
            totals["commands"][mode] += button.release_count
            totals["cancels"][mode] += button.cancel_count
        now_ns += 1_000_000_000
        done += CLIP_FRAMES
        step(CLIP_FRAMES)
    return IdleResult(frames=done, noise_frames=sum(len(clip.image) for clip in clips), **totals)


def _noisy(scene: Scene, noise: NoiseClip, index: int) -> Hand | None:
    """There and back again, so that the noise never jumps more than MediaPipe's own."""
    turn = index % (2 * len(noise.image) - 1)
    row = turn if turn < len(noise.image) else 2 * len(noise.image) - 1 - turn
    return with_noise(scene, noise.image[row], noise.world[row], tracked=index > 0)


Move = Callable[[np.random.Generator, Scene], Iterator[Scene]]


def _wander(draw: np.random.Generator, scene: Scene) -> Iterator[Scene]:
    """Anywhere beyond the threshold, with any tilt up to 55°."""
    poses = [_place(draw, scene.lens, CLEAR_M) for _ in range(4)]
    yield from _along(scene, poses)


def _wave(draw: np.random.Generator, scene: Scene) -> Iterator[Scene]:
    """Rolling from side to side over the button."""
    z, swing, rate = draw.uniform(CLEAR_M, 0.6), draw.uniform(0.3, 0.9), draw.uniform(1.0, 3.0)
    for frame in range(CLIP_FRAMES):
        phase = math.sin(2 * math.pi * rate * frame / 30)
        yield _put(scene, np.array([0.06 * phase, HEIGHT_M, z, 0.0, 0.3 * phase, swing * phase]))


def _turn(draw: np.random.Generator, scene: Scene) -> Iterator[Scene]:
    """Turning the palm away and back, over the button."""
    z, most = draw.uniform(CLEAR_M, 0.6), draw.uniform(0.8, math.pi)
    for frame in range(CLIP_FRAMES):
        amount = most * (1 - math.cos(2 * math.pi * frame / CLIP_FRAMES)) / 2
        yield _put(scene, np.array([0.0, HEIGHT_M, z, 0.0, amount, 0.0]))


def _pass(draw: np.random.Generator, scene: Scene) -> Iterator[Scene]:
    """In from one side, across the button nearer than the threshold, out at the other."""
    z = draw.uniform(0.12, THRESHOLD_M)
    reach = 0.6 * z * scene.lens.width_px / scene.lens.fx_px
    start, end = (-reach, reach) if draw.random() < 0.5 else (reach, -reach)
    poses = [np.array([x, HEIGHT_M, z, 0.0, 0.0, 0.0]) for x in (start, end, start)]
    yield from _along(scene, poses)


def _reach_without_gesture(draw: np.random.Generator, scene: Scene) -> Iterator[Scene]:
    """Straight to the camera and back with a hand that signs nothing."""
    nearest = draw.uniform(0.12, THRESHOLD_M)
    far, near = (np.array([0.0, HEIGHT_M, z, 0.0, 0.0, 0.0]) for z in (0.45, nearest))
    yield from _along(scene, [far, near, far])


MOVES: tuple[Move, ...] = (_wander, _wave, _turn, _pass, _wander, _reach_without_gesture)


def _gesture(draw: np.random.Generator, noise: NoiseClip, move: Move) -> str:
    """The gesture that the noise was taken from; a look-alike where a gesture would make it a press."""
    return str(draw.choice(LOOK_ALIKES)) if move is _reach_without_gesture else noise.gesture


def _along(scene: Scene, poses: list[FloatArray]) -> Iterator[Scene]:
    legs = len(poses) - 1
    for frame in range(CLIP_FRAMES):
        along = legs * frame / (CLIP_FRAMES - 1)
        first = min(legs - 1, int(along))
        share = smooth(along - first)
        yield _put(scene, poses[first] * (1 - share) + poses[first + 1] * share)


def _place(draw: np.random.Generator, lens: Intrinsics, nearest_m: float) -> FloatArray:
    z = draw.uniform(nearest_m, 0.70)
    reach = 0.5 * z * np.array([lens.width_px, lens.height_px]) / lens.fx_px
    pitch, yaw = tilted(math.radians(draw.uniform(0, 55)), draw.uniform(0, 2 * math.pi))
    x, y = draw.uniform(-reach, reach)
    return np.array([x, y, z, pitch, yaw, draw.uniform(-0.5, 0.5)])


def _put(scene: Scene, now: FloatArray) -> Scene:
    """The scene's hand at (x, y, z), its natural turn plus (pitch, yaw, roll)."""
    assert scene.place is not None
    turn = np.asarray(scene.place.turn_rad) + now[3:]
    place = replace(
        scene.place,
        position_m=(float(now[0]), float(now[1]), float(now[2])),
        turn_rad=(float(turn[0]), float(turn[1]), float(turn[2])),
    )
    return replace(scene, place=place)


def idle_table(result: IdleResult) -> Table:
    """Commands of hands that pressed nothing."""
    rows = [(mode, result.commands[mode], result.presses[mode], result.cancels[mode]) for mode in MODES]
    columns = "empty commands presses cancelled"
    return table("idle", columns, rows, left=4, frames=f"{result.frames:,}", noise_frames=result.noise_frames)
