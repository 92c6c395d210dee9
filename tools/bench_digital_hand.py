"""What a frame of the digital hand costs: CPU time at 1280x720, at rest and pressing, with and without depth."""

from __future__ import annotations

import time

import cv2
import numpy as np

from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.skeleton import GESTURES

FRAMES = 60
PERIOD_NS = 33_333_333


def cpu_ms(camera: DigitalHandCamera, start_ns: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """CPU milliseconds of each frame, all threads."""
    spent = []
    for number in range(FRAMES):
        before = time.process_time()
        camera.render(start_ns + number * PERIOD_NS)
        spent.append((time.process_time() - before) * 1000)
    return np.array(spent)


def main() -> None:
    cv2.setNumThreads(1)
    print(f"{'hand':24}{'depth':>6}{'median ms':>11}{'p95 ms':>8}")
    for press in (False, True):
        for depth in (False, True):
            costs = []
            for gesture in ("5", "0", "7"):
                camera = DigitalHandCamera(depth=depth, gesture=gesture, clock_ns=lambda: 0)
                camera.command(press=press, at_ns=0)
                camera.render(0)
                costs.append(cpu_ms(camera, 2_000_000_000))
            every = np.concatenate(costs)
            where = "pressing, about 15 cm" if press else "at rest, about 36 cm"
            print(f"{where:24}{'yes' if depth else 'no':>6}{np.median(every):11.1f}{np.percentile(every, 95):8.1f}")
    camera = DigitalHandCamera(clock_ns=lambda: 0)
    camera.render(0)
    for number, pose in enumerate(GESTURES):
        camera.command(gesture=pose.name, at_ns=number * 1_000_000_000)
    morphs = np.concatenate([cpu_ms(camera, number * 1_000_000_000) for number in range(3)])
    print(f"{'changing gestures':24}{'no':>6}{np.median(morphs):11.1f}{np.percentile(morphs, 95):8.1f}")


if __name__ == "__main__":
    main()
