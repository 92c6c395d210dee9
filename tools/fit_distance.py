"""How the readings of `kgdfa/distance.py` err on digital hands that no evaluation uses, and what the margins do.

Prints, a direction of tilt, the median error of each reading and of the fused distance after a common calibration;
then, for Eq. 4 times several factors and for the button's distance, how far upright hands read and how often any hand
reads near by over 3 %. docs/explanation/distance.md tells how the constants in `kgdfa/distance.py` were chosen.

    python tools/fit_distance.py MODEL [--hands 40]
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import typer
from numpy.typing import NDArray

from app.evaluate.detector_pool import PoolDetector, detector_pool, map_pool
from app.evaluate.hand_motions import held, take, tilted
from app.evaluate.readings import GESTURE_NAMES
from hal.cameras.digital_hand.render import lens_for, person_of
from kgdfa.robust_distance import RobustRange

TILTS_DEG = (0, 20, 40)
FRAMES = 4
DIRECTIONS = 8
FACTORS = (1.00, 1.03, 1.05, 1.08, 1.10, 1.15)
NAMES = ("shape", "landmarks", "Eq. 4", "fused")

# gesture is 5, tilt in degrees, direction, tilt as measured, then true distance over: shape, landmarks, Eq. 4, shown,
# and the far reading, the button's
Row = tuple[float, ...]
Table = NDArray[np.float64]


def measure_hand(detector: PoolDetector, seed: int) -> list[Row]:
    """One hand, upright and tilted every way, gesture 5 and one other."""
    draw, person = np.random.default_rng([seed, 0x666974]), person_of(seed)
    lens = lens_for(focal_px=650.0 if seed % 3 else 950.0)
    rows: list[Row] = []
    for tilt_deg in TILTS_DEG:
        for direction in range(DIRECTIONS if tilt_deg else 1):
            turn = tilted(math.radians(tilt_deg), direction * 2 * math.pi / DIRECTIONS)
            for gesture in ("5", GESTURE_NAMES[int(draw.integers(12))]):
                finder = RobustRange(
                    focal_px=lens.fx_px, reference_m=person.shape.reference_m, centre_px=(lens.cx_px, lens.cy_px)
                )
                detector.reset()
                moments = held(gesture, person=person, lens=lens, distance_m=float(draw.uniform(0.2, 0.6)),
                               turn_rad=turn, seed=seed, frames=FRAMES)  # fmt: skip
                for index, moment in enumerate(moments):
                    hands = detector.detect(take(moment, index)[0])
                    measured = finder.explain(hands[0]) if hands else None
                    if measured is not None:
                        each = (*measured.readings_m, measured.shown_m, measured.far_m)
                        side = (DIRECTIONS // 2 - direction) % DIRECTIONS if person.shape.left else direction
                        rows.append(
                            (gesture == "5", tilt_deg, side, measured.tilt_rad, *(m / moment.true_m for m in each))
                        )
    return rows


def print_readings(table: Table) -> None:
    """Median error of each reading, %, gesture 5, after one calibration of each on upright hands."""
    five = table[table[:, 0] == 1]
    upright = np.median(five[five[:, 1] == 0][:, 4:8], axis=0)
    print(f"\n{'tilt':>6}{'towards':>9}" + "".join(f"{name:>11}" for name in NAMES) + "   median error, %, gesture 5")
    for tilt_deg in TILTS_DEG[1:]:
        for direction in range(DIRECTIONS):
            chosen = five[(five[:, 1] == tilt_deg) & (five[:, 2] == direction)][:, 4:8]
            if len(chosen):
                errors = 100 * (np.median(chosen / upright, axis=0) - 1)
                cells = "".join(f"{error:>+11.1f}" for error in errors)
                print(f"{tilt_deg:>5}°{direction * 360 // DIRECTIONS:>8}°{cells}")


def print_safe_sides(table: Table) -> None:
    """What standing so far beyond Eq. 4 costs upright hands, and what it saves; the button's distance last."""
    upright = table[:, 1] == 0
    print(f"\n{'distance':>12}{'upright reads far by':>24}{'near by over 3 %':>20}")
    ways = [(f"{factor:.2f} Eq. 4", factor * table[:, 6]) for factor in FACTORS]
    for name, far in (*ways, ("button's", table[:, 8])):
        print(f"{name:>12}{100 * (np.median(far[upright]) - 1):>22.1f} %{100 * np.mean(far < 0.97):>18.2f} %")


def main(model: Path, hands: int = 40, workers: int = 2) -> None:
    """Look at the hands with seeds from 1 on, and print both tables."""
    with detector_pool(model, workers) as pool:
        found = map_pool(pool, measure_hand, list(range(1, hands + 1)), lambda: print(".", end="", flush=True))
    table = np.array([row for rows in found for row in rows])
    print(f"\n{hands} hands, {len(table)} frames")
    print_readings(table)
    print_safe_sides(table)


if __name__ == "__main__":
    typer.run(main)
