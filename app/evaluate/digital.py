"""The digital hand as the evaluations use it: labelled scenes, motions before a camera, and pools of detectors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.util import Finalize
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from app.evaluate.harness import FRAME_NS, Step, process_pool
from app.evaluate.readings import GESTURE_NAMES, NONE_PREFIX, DetectedImage, LabelledImage
from hal.cameras.camera import DepthArray, ImageArray, Intrinsics
from hal.cameras.digital_hand.depth import DepthCamera
from hal.cameras.digital_hand.render import WALL_M, Person, Scene, keypoints_m, person_of, posed, render
from hal.cameras.digital_hand.skeleton import POSES, HandPlace, find_pose
from kgdfa.hand import FloatArray, Hand, Keypoint, Side
from kgdfa.keypoints import HandDetector, live_detector
from kgdfa.preprocess import Image, Prepare, as_bgr8

SOURCE = "digital hand"
MAX_TILT_RAD = np.radians(30.0)
NEAR_M, FAR_M = 0.20, 0.60
MEASURE_SEEDS = 10_000  # people from here on measure
FIT_SEEDS = 1_000_000  # and people from here on fit: nobody does both
HELD_FRAMES = 4  # a hand found is detected again as often as a vote needs, and once more
MAX_FRAMES = 10  # a third of a second
PALM = (Keypoint.INDEX_MCP, Keypoint.PINKY_MCP)  # keypoint 21 lies between them
HEIGHT_M = 0.015  # keypoint 21 below the image's centre: fingers and wrist then have equal room
_KINDS = {"naturally open": "natural_open", "thumb up": "good", "O": "o_shape"}  # as labels.csv calls them
GAP_NS = 1_000_000_000
LabelledScene = tuple[LabelledImage, Scene, int]  # with the seed of the image's noise
EDGE_SHARE = 0.46  # of the image's width from its middle: keypoint 21 is in the image still, half of the hand is not
FLIP, OPEN_CLOSE, EDGE, BACKGROUND = CHANGES = ("flip", "open and close", "edge", "background jump")


def label_of(pose: str) -> str:
    """A pose's label as labels.csv has it."""
    return pose if pose in GESTURE_NAMES else NONE_PREFIX + _KINDS.get(pose, pose.replace(" ", "_").replace("-", "_"))


def side_of(person: Person) -> Side:
    """Of a person's hand, in truth."""
    return Side.LEFT if person.shape.left else Side.RIGHT


def digital_scenes(per_pose: int, first_seed: int) -> Iterator[LabelledScene]:
    """`per_pose` people, each showing every pose, tilted and placed anew; with the seed of the image's noise."""
    for person in range(first_seed, first_seed + per_pose):
        for place, pose in enumerate(POSES):
            seed = person * len(POSES) + place
            labelled = LabelledImage(path=f"{pose}/{seed}", label=label_of(pose), source=SOURCE, group=str(person))
            yield labelled, scene_of(pose, person, seed), seed


def scene_of(pose: str, person: int, seed: int) -> Scene:
    """One person showing one pose: tilted by up to 30° about any axis, 20 to 60 cm away, in the image's middle."""
    return tilted_scene(pose, person, np.random.default_rng(seed), MAX_TILT_RAD)


def tilted_scene(
    pose: str, person: int, draw: np.random.Generator, most_tilt_rad: float, angles_deg: FloatArray | None = None
) -> Scene:
    """As `scene_of`, tilted by up to so much; with joint angles (5, 6) of its own, it is turned as that pose is."""
    axis = draw.normal(size=3)
    x, y, z = (axis / np.linalg.norm(axis) * draw.uniform(0, most_tilt_rad)).tolist()
    distance_m = float(draw.uniform(NEAR_M, FAR_M))
    scene = posed(pose, person=person_of(person), position_m=(0.0, 0.0, distance_m), turn_rad=(x, y, z))
    return centred(scene if angles_deg is None else replace(scene, angles_deg=angles_deg), distance_m)


def centred(scene: Scene, distance_m: float) -> Scene:
    """The same hand in the image's middle."""
    points = keypoints_m(scene)
    if points is None or scene.place is None:
        return scene
    middle: FloatArray = (points.min(axis=0) + points.max(axis=0)) / 2
    place = replace(scene.place, position_m=(-float(middle[0]), -float(middle[1]), distance_m))
    return replace(scene, place=place)


def image_of_scene(scene: Scene, seed: int) -> Image:
    """The image of a scene, (720, 1280, 3)."""
    return render(scene, seed).image_bgr


def detect_digital(
    model: Path,
    scenes: Iterable[LabelledScene],
    step: Step = lambda: None,
    prepare: Prepare = as_bgr8,
) -> list[DetectedImage]:
    """Every hand held still until it was detected in as many frames as a vote needs, for a third of a second at most,
    found and tracked as before a camera; the last frame counts.
    """
    detected, now_ns = [], 0
    with HandDetector(model, search=True) as detector:
        for labelled, scene, seed in scenes:
            shown = prepare(image_of_scene(scene, seed))
            hands: tuple[Hand, ...] = ()
            found_frames = 0
            detector.reset(now_ns)
            for _ in range(MAX_FRAMES):
                now_ns += FRAME_NS
                hands = detector.detect(shown, now_ns)
                found_frames += bool(hands)
                if found_frames == HELD_FRAMES:
                    break
            detected.append(DetectedImage(image=labelled, hands=hands))
            step()
    return detected


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One frame to come. flipping: the depth camera fails in patches. wall_m: what lies behind the hand."""

    scene: Scene
    flipping: bool = False
    wall_m: float = WALL_M

    @property
    def true_m(self) -> float:
        """Distance of keypoint 21."""
        joints = keypoints_m(self.scene)
        assert joints is not None
        return float(joints[list(PALM), 2].mean())


def take(moment: Moment, noise_seed: int, depth: DepthCamera | None = None) -> tuple[ImageArray, DepthArray | None]:
    """The image, and the depth map as a D435i would measure it, when there is one."""
    rendered = render(moment.scene, noise_seed, depth=depth is not None)
    if depth is None or rendered.surface_m is None:
        return rendered.image_bgr, None
    surface = np.where(rendered.surface_m == np.float32(WALL_M), np.float32(moment.wall_m), rendered.surface_m)
    return rendered.image_bgr, depth.measure(surface.astype(np.float32), noise_seed, moment.flipping)


def held(
    gesture: str,
    *,
    person: Person,
    lens: Intrinsics,
    distance_m: float,
    turn_rad: tuple[float, float],
    seed: int,
    frames: int,
) -> Iterator[Moment]:
    """A hand held still, with a person's tremor: 2 mm and half a degree."""
    draw = np.random.default_rng([seed, round(distance_m * 1000)])
    for _ in range(frames):
        shake_m, shake_rad = draw.normal(0, 0.002, 2), draw.normal(0, 0.01, 3)
        turn = (turn_rad[0] + shake_rad[0], turn_rad[1] + shake_rad[1], shake_rad[2])
        position = (float(shake_m[0]), HEIGHT_M + float(shake_m[1]), distance_m)
        yield Moment(scene=posed(gesture, person=person, lens=lens, position_m=position, turn_rad=turn))


def tilted(angle_rad: float, direction_rad: float) -> tuple[float, float]:
    """Pitch and yaw of a tilt of that size towards that direction."""
    return angle_rad * math.sin(direction_rad), angle_rad * math.cos(direction_rad)


def walk(gesture: str, *, person: Person, lens: Intrinsics, seed: int, frames: int) -> Iterator[Moment]:
    """A second of random movement through three places and poses: 14 to 70 cm, tilts to 55°, all over the image."""
    draw = np.random.default_rng([seed, 0x77616C6B])
    poses = [_pose(draw, lens) for _ in range(3)]
    for now in smooth_path(poses, frames):
        x, y, z, pitch, yaw, roll = now.tolist()
        yield Moment(scene=posed(gesture, person=person, lens=lens, position_m=(x, y, z), turn_rad=(pitch, yaw, roll)))


def _pose(draw: np.random.Generator, lens: Intrinsics) -> FloatArray:
    z = draw.uniform(0.14, 0.70)
    reach = 0.6 * z * np.array([lens.width_px, lens.height_px]) / 2 / lens.fx_px
    pitch, yaw = tilted(math.radians(draw.uniform(0, 55)), draw.uniform(0, 2 * math.pi))
    x, y = draw.uniform(-reach, reach)
    return np.array([x, y + HEIGHT_M, z, pitch, yaw, draw.uniform(-0.4, 0.4)])


def smooth_path(poses: Sequence[FloatArray], frames: int) -> Iterator[FloatArray]:
    """So many places from the first pose through all of them to the last, at rest in each."""
    legs = len(poses) - 1
    for frame in range(frames):
        along = legs * frame / max(1, frames - 1)
        first = min(legs - 1, int(along))
        share = smooth(along - first)
        yield poses[first] * (1 - share) + poses[first + 1] * share


def smooth(share: float) -> float:
    """0 to 1 with no jerk at either end."""
    held_share = min(1.0, max(0.0, share))
    return held_share * held_share * (3 - 2 * held_share)


def approach_and_change(
    change: str,
    *,
    person: Person,
    lens: Intrinsics,
    distance_m: float,
    frames: tuple[int, int, int],
    leftwards: bool = False,
) -> Iterator[Moment]:
    """Gesture 5 shown 15 cm farther out (at least 35 cm), brought to the distance, there changed in posture.

    frames: showing, approaching, changing. leftwards: to which edge of the image.
    """
    start_m = max(0.35, distance_m + 0.15)
    showing, approaching, changing = frames
    still = posed("5", person=person, lens=lens, position_m=(0.0, HEIGHT_M, start_m))
    for frame in range(showing + approaching):
        share = smooth((frame - showing + 1) / approaching)
        z = start_m + (distance_m - start_m) * share
        yield Moment(scene=_moved(still, z=z))
    there = _moved(still, z=distance_m)
    for frame in range(changing):
        amount, late = math.sin(math.pi * (frame + 1) / (changing + 1)), frame >= changing // 2
        yield _changed(change, there, amount, late=late, leftwards=leftwards)


def _changed(change: str, there: Scene, amount: float, *, late: bool, leftwards: bool) -> Moment:
    """The scene with the change done to 0-1 and back again."""
    assert there.place is not None
    if change == FLIP:
        return Moment(scene=_moved(there, yaw=math.pi * amount), flipping=True)
    if change == OPEN_CLOSE:
        fist = find_pose("0").angles_deg
        angles = there.angles_deg * (1 - amount) + fist * amount
        return Moment(scene=replace(there, angles_deg=angles), flipping=True)
    if change == EDGE:
        edge_m = EDGE_SHARE * there.lens.width_px / there.lens.fx_px * there.place.position_m[2]
        return Moment(scene=_moved(there, x=(-edge_m if leftwards else edge_m) * amount))
    behind = replace(there.person, room_seed=there.person.room_seed + 1) if late else there.person
    return Moment(scene=replace(there, person=behind), wall_m=there.place.position_m[2] + 0.15 if late else WALL_M)


def _moved(scene: Scene, *, x: float | None = None, z: float | None = None, yaw: float = 0.0) -> Scene:
    assert scene.place is not None
    was, (pitch, before, roll) = scene.place.position_m, scene.place.turn_rad
    position = (was[0] if x is None else x, was[1], was[2] if z is None else z)
    return replace(scene, place=HandPlace(position_m=position, turn_rad=(pitch, before + yaw, roll)))


Piece = TypeVar("Piece")
Result = TypeVar("Result")


@dataclass(slots=True)
class PoolDetector:
    """A detector with its own clock."""

    inner: HandDetector
    now_ns: int = GAP_NS

    def reset(self) -> None:
        """A pause, and nothing is remembered: results do not depend on what the detector saw before."""
        self.now_ns += GAP_NS
        self.inner.reset(self.now_ns)

    def detect(self, image_bgr: Image) -> tuple[Hand, ...]:
        """The hands in the next frame, captured at `now_ns`."""
        self.now_ns += FRAME_NS
        return self.inner.detect(image_bgr, self.now_ns)


Work = Callable[[PoolDetector, Piece], Result]
_detector: list[PoolDetector] = []  # this process's own


@contextmanager
def detector_pool(model: Path, count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes with a detector each; on leaving early, work not begun is dropped.

    Raises KgdfaError for a model that is none, AppError when one of the processes ends.
    """
    HandDetector(model).close()  # here: a process that can't begin has no sentence
    with process_pool(count, initializer=_begin, initargs=(model,)) as pool:
        yield pool


def map_pool(pool: ProcessPoolExecutor, work: Work[Piece, Result], pieces: Sequence[Piece], step: Step) -> list[Result]:
    """`work` done on every piece, results in their order; `step` is called as each ends."""
    return list(iterate_pool(pool, work, pieces, step))


def iterate_pool(
    pool: ProcessPoolExecutor, work: Work[Piece, Result], pieces: Sequence[Piece], step: Step
) -> Iterator[Result]:
    """The same, each result as soon as it and those before it are there."""

    def done(_: Future[Result]) -> None:
        step()

    futures = [pool.submit(_do, work, piece) for piece in pieces]
    for future in futures:
        future.add_done_callback(done)
    for future in futures:
        yield future.result()


def _begin(model: Path) -> None:
    cv2.setNumThreads(1)
    detector = live_detector(model)
    # MediaPipe can't free its model any more once the interpreter winds up its threads.
    Finalize(None, detector.close, exitpriority=1)
    _detector.append(PoolDetector(detector))


def _do(work: Work[Piece, Result], piece: Piece) -> Result:
    detector = _detector[0]
    detector.reset()
    return work(detector, piece)
