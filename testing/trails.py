"""A made-up but whole session's trail, for measuring and for looking at: `python -m testing.trails FOLDER`.

Everything in it is written by the same writer as a real session; only the walking is invented.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from logs import records as r
from logs.disk import Disk
from logs.journal import Moment
from logs.keys import load_or_make_key
from logs.mirror import CheckpointCopy
from logs.writer import SessionWriter

COURSE = (
    ("0", "initialise", "unpowered", "standing"),
    ("1", "step: right leg starts", "standing", "right leg forward"),
    ("2", "step: left leg", "right leg forward", "left leg forward"),
    ("3", "step: right leg", "left leg forward", "right leg forward"),
    ("4", "step: close and stand", "right leg forward", "standing"),
    ("7", "climb a stair", "standing", "standing"),
    ("love", "sit down", "standing", "sitting"),
    ("rock", "stand up", "sitting", "standing"),
)
REASONS = ("The hand left the picture", "No such action from sitting", "The gesture changed while pressed", "Not armed")


class _Clock:
    def __init__(self, began_ns: int) -> None:
        self.began_ns = began_ns
        self.s = 0.0

    def moment(self) -> Moment:
        ns = int(self.s * 1e9)
        return Moment(wall_ns=self.began_ns + ns, monotonic_ns=10**12 + ns, operator="Ann Berg")


def bodies(minutes: float, clock: _Clock, rng: random.Random, per_second: int = 1) -> Iterator[tuple[str, r.Body]]:
    """(process, body) of a session; moves the clock as it goes."""
    yield "control", r.RealTimePrivilege(fifo=True, memory_locked=True, core=1, cores_awake=True)
    yield "perception", _CAMERA
    yield "control", r.Arming(armed=True)
    number, state = 0, "unpowered"
    while clock.s < minutes * 60:
        number += 1
        gesture, _, _, state = COURSE[number % len(COURSE)]
        yield from _action(number, clock, rng)
        for _ in range(rng.randint(3, 9)):
            for _ in range(per_second):
                clock.s += 1.0 / per_second
                yield "control", joints(clock.s, state, rng)
        if rng.random() < 0.15:
            yield "control", r.Refusal(reason=rng.choice(REASONS), source="gesture", state=state, gesture=gesture)
        if rng.random() < 0.03:
            yield from _event(state, clock, rng)
    yield "console", r.Discomfort(rating=2)
    yield "console", r.Note(text="Tired after the stairs; shorter session next time.")


_CAMERA = r.Camera(
    camera="digital hand", width_px=1280, height_px=720, rate_hz=30, focal_px=650, intrinsics_source="given"
)


def _action(number: int, clock: _Clock, rng: random.Random) -> Iterator[tuple[str, r.Body]]:
    gesture, action, begin, end = COURSE[number % len(COURSE)]
    steps = sum("step" in COURSE[one % len(COURSE)][1] for one in range(1, number + 1))
    observed = clock.moment().monotonic_ns
    yield "perception", r.GestureOnset(gesture=gesture, confidence=rng.uniform(0.8, 1), votes=3, captured_ns=observed)
    clock.s += 0.3
    yield "perception", r.Press(gesture=gesture, captured_ns=observed, distance_m=0.19, threshold_m=0.2)
    clock.s += 0.2
    released = clock.moment().monotonic_ns
    yield "perception", r.Release(gesture=gesture, recognised_ns=observed, captured_ns=released, number=number)
    first = released + int(rng.gauss(42, 8) * 1e6)
    clock.s += 0.05
    yield (
        "control",
        r.Command(number=number, action=action, source="gesture", state=begin, gesture=gesture, accepted_ns=released),
    )
    plan = r.PlanChecked(number=number, action=action, phase="whole", ok=True, reason="", duration_s=2.0)
    yield "planner", plan
    clock.s += 2.0
    yield "control", r.Transition(from_state=begin, to_state=end, action=action, number=number)
    yield (
        "control",
        r.ActionEnd(
            number=number,
            action=action,
            source="gesture",
            from_state=begin,
            to_state=end,
            outcome="completed",
            recognised_ns=observed,
            released_ns=released,
            accepted_ns=released + 20_000_000,
            first_command_ns=first,
            first_motion_ns=first + 120_000_000,
            ended_ns=clock.moment().monotonic_ns,
            tracking_rms_rad=abs(rng.gauss(0.012, 0.003)),
            steps=steps,
            distance_m=0.3 * steps,
        ),
    )


def joints(at_s: float, state: str, rng: random.Random) -> r.JointStatistics:
    """A second of joints."""
    swing = math.sin(at_s / 3)
    mean = (0.3 * swing, 0.4 + 0.3 * swing, -0.3 * swing, 0.4 - 0.3 * swing)
    return r.JointStatistics(
        period_s=1.0,
        angle_min_rad=tuple_of(mean, -0.1),
        angle_mean_rad=mean,
        angle_max_rad=tuple_of(mean, 0.1),
        target_mean_rad=tuple_of(mean, rng.gauss(0, 0.01)),
        torque_min_nm=tuple_of(mean, -5.0),
        torque_mean_nm=tuple_of(mean, 3.0),
        torque_max_nm=tuple_of(mean, 11.0),
        temperature_c=tuple_of((31.0, 33.0, 31.5, 34.0), 10 * (1 - math.exp(-at_s / 900))),
        state=state,
    )


def tuple_of(values: tuple[float, float, float, float], shift: float) -> tuple[float, float, float, float]:
    """All four moved by the same."""
    first, second, third, fourth = (round(value + shift, 6) for value in values)
    return first, second, third, fourth


def _event(state: str, clock: _Clock, rng: random.Random) -> Iterator[tuple[str, r.Body]]:
    yield "control", r.HeartbeatLost(stream="trigger", age_ms=210)
    yield (
        "control",
        r.EventRaised(event="perception silent", effect="hold", text="The camera is silent: look at its cable."),
    )
    yield "control", r.EffectChanged(from_effect="note", to_effect="hold")
    if rng.random() < 0.4:
        yield "control", r.Stop(state=state, effect="hold")
    clock.s += 1.5
    yield "control", r.HeartbeatFound(stream="trigger", silent_ms=1700)
    yield "control", r.EventCleared(event="perception silent", effect="hold", lasted_s=1.5)
    clock.s += rng.uniform(1, 8)
    yield "control", r.Acknowledgement(events=("perception silent",), waited_s=rng.uniform(2, 9))
    yield "control", r.EffectChanged(from_effect="hold", to_effect="note")


def write_sample(
    home: Path,
    minutes: float,
    seed: int = 1,
    per_second: int = 1,
    patient: str = "P-017",
    *,
    purpose: str = "",
    parameters: dict[str, Any] | None = None,
    of_console: Iterable[r.Body] = (),
) -> Path:
    """A session of so many minutes in a home's logs; `per_second` joint records a second make it longer.

    of_console: what the console records at its end.
    """
    folder = home / "logs"
    folder.mkdir(parents=True, exist_ok=True)
    clock, rng = _Clock(1_795_000_000_000_000_000 + seed * 86_400_000_000_000), random.Random(seed)
    name = datetime.fromtimestamp(clock.began_ns / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ") + f"-{seed:04x}"
    writer = SessionWriter(folder, name, load_or_make_key(home / "keys"), Disk(), CheckpointCopy(""))
    versions = {"rleex": "0.1.0", "python": "3.11"}
    start = r.SessionStart(versions=versions, configuration={}, simulated=True, purpose=purpose)
    writer.begin(start, clock.moment())
    writer.take(clock.moment().entry(r.PatientChosen(patient=patient, parameters=parameters or {})))
    at_end = (("console", body) for body in of_console)
    for count, (process, body) in enumerate(chain(bodies(minutes, clock, rng, per_second), at_end)):
        now = clock.moment()
        writer.take(replace(now.entry(body), process=process))
        if count % 1000 == 0:
            writer.settle(now.monotonic_ns)
    writer.end("ended by the console", clock.moment())
    writer.finish(clock.moment())
    writer.close()
    return writer.path


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("home", type=Path)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--per-second", type=int, default=1)
    options = parser.parse_args()
    began = time.perf_counter()
    path = write_sample(options.home, options.minutes, options.seed, options.per_second)
    seconds = time.perf_counter() - began
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB in {seconds:.1f} s")


if __name__ == "__main__":
    main()
