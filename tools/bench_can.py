"""The CAN driver at 500 Hz with four emulated drives on python-can's `virtual` bus, beside the real perception.

python tools/bench_can.py [--seconds 120] [--alone] [--home PATH]
Round trip, ticks missed and reported, the driver's own cost, and the time from a fault to the tick that acts on it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.control.silence import JOINT_TIMEOUT_MS
from app.ipc.links import LatestReceiver, address
from app.ipc.messages import TriggerReport
from app.ipc.streams import TRIGGER
from app.session.child import run_process
from app.session.setup import make_setup
from app.system.authority import demonstration
from app.system.config import Config, load_config
from app.system.paths import find_home
from app.system.scheduling import PeriodicTimer, acquire_real_time, disable_gc
from hal.joints.can.bus import with_bus
from hal.joints.can.driver import SocketCanJoints
from hal.joints.device import load_exoskeleton
from hal.joints.emulator.emulator import DriveEmulator
from hal.joints.emulator.faults import Fault
from hal.joints.protocol import BusFault, Joint, JointCommand, JointFeedback
from profiles.schema import DEMO_PATIENT
from testing.emulated_drives import emulating
from testing.request_tracker import RequestTracker, TrackedDrive

PERIOD_NS = 2_000_000
ROUND_TRIP_BOUND_MS = 2.0
FAULT_BOUND_MS = 20.0
FAULT_TRIALS = 20
_ZERO = np.zeros(4)
_SILENT_NS = JOINT_TIMEOUT_MS * 1e6

# fault → what control's table of events tests
ACTED_ON: dict[Fault, Callable[[JointFeedback, int], bool]] = {
    Fault.SILENT: lambda reported, now_ns: bool((now_ns - reported.measured_ns).max() > _SILENT_NS),
    Fault.ERROR: lambda reported, _: any(reported.faults),
    Fault.BUS_OFF: lambda reported, _: BusFault.BUS_OFF in reported.bus,
}


def target(at_s: float) -> JointCommand:
    """Legs that swing at half a hertz."""
    return JointCommand(
        position_rad=_ZERO + 0.3 * np.sin(np.pi * at_s),
        velocity_rad_s=_ZERO + 0.3 * np.pi * np.cos(np.pi * at_s),
        stiffness_nm_rad=_ZERO + 200.0,
        damping_nm_s_rad=_ZERO + 5.0,
        torque_nm=_ZERO,
    )


@contextmanager
def perception(home: Path | None) -> Iterator[Callable[[], float]]:
    """The session's own perception process on the digital hand; yields its frames per second so far."""
    place = find_home(home)
    config = Config(model=load_config(place.config).model)
    setup = make_setup(place, config, DEMO_PATIENT, demonstration(place, config.joints, "bench"))
    process = multiprocessing.get_context("spawn").Process(target=run_process, args=("perception", setup), daemon=True)
    receiver: LatestReceiver[TriggerReport] = LatestReceiver(address(setup.links, TRIGGER.name), TriggerReport)
    process.start()
    rates: list[float] = []

    def rate() -> float:
        while (report := receiver.receive()) is not None:
            rates.append(report.fps)
        return float(np.median(rates)) if rates else 0.0

    end_s = time.monotonic() + 90.0
    try:
        while receiver.receive(0.5) is None:
            if time.monotonic() > end_s:
                raise SystemExit("perception did not start; run `rleex model` first, or use --alone")
        yield rate
    finally:
        process.terminate()
        process.join(5.0)
        receiver.close()


class Run:
    """One driver against one emulator, tick by tick."""

    def __init__(self, joints: SocketCanJoints, emulator: DriveEmulator) -> None:
        self.joints, self.emulator = joints, emulator
        tracked = tuple(TrackedDrive(drive.joint, drive.device, drive.model) for drive in joints.drives)
        joints.drives, self.ledgers = tracked, [drive.requests for drive in tracked]
        self.pace = PeriodicTimer(period_ns=PERIOD_NS, next_ns=time.monotonic_ns() + PERIOD_NS)
        self.late_ms: list[float] = []
        self.cost_ms: list[float] = []
        self.age_ms: list[float] = []
        self.missed_ticks = 0
        self.ticks = 0
        self._begin_s = time.monotonic()

    def tick(self) -> tuple[JointFeedback, int]:
        """Wait for the next tick, read, write."""
        now_ns, late_ns, missed = self.pace.wait()
        self.missed_ticks += missed
        self.late_ms.append(late_ns / 1e6)
        before_s = time.thread_time()
        reported = self.joints.read(now_ns)
        self.joints.write(target(time.monotonic() - self._begin_s), now_ns)
        self.cost_ms.append((time.thread_time() - before_s) * 1e3)
        for requests in self.ledgers:
            requests.poll(now_ns)
        self.age_ms.append(float((now_ns - reported.measured_ns).max()) / 1e6)
        self.ticks += 1
        return reported, now_ns

    def start(self) -> None:
        """From whatever state to enabled and answering."""
        self.joints.close(time.monotonic_ns())
        self.joints.open(time.monotonic_ns())
        self.joints.enable(time.monotonic_ns())
        self.pace.next_ns = time.monotonic_ns() + PERIOD_NS
        for _ in range(25):
            self.tick()


def percentiles(values: list[float]) -> str:
    """Median, p99, largest."""
    p50, p99 = np.percentile(values, [50, 99])
    return f"p50 {p50:.3f}  p99 {p99:.3f}  max {max(values):.3f} ms"


class Tally(NamedTuple):
    """What became of commands: each is in exactly one class, `in_flight` as it was at the end less at the beginning."""

    sent: int
    replies: int
    late: int
    missed: int
    in_flight: int

    @classmethod
    def of(cls, ledgers: list[RequestTracker]) -> Tally:
        """All drives' so far."""
        rows = [(book.sent, book.answered, book.late, book.missed, book.in_flight) for book in ledgers]
        return cls(*(sum(column) for column in zip(*rows, strict=True)))

    def since(self, before: Tally) -> Tally:
        """What was added."""
        return Tally(*(now - then for now, then in zip(self, before, strict=True)))

    @property
    def sum(self) -> int:
        """Of the classes."""
        return self.replies + self.late + self.missed + self.in_flight

    def __str__(self) -> str:
        return f"{self.replies} answered, {self.late} late, {self.missed} missed, {self.in_flight} under way"


def steady(run: Run, seconds: float) -> bool:
    """The long run; whether round trip and book-keeping keep their bounds."""
    ledgers = run.ledgers
    for requests in ledgers:
        requests.round_trips_ns.clear()
    before = Tally.of(ledgers)
    for gathered in (run.late_ms, run.cost_ms, run.age_ms):
        gathered.clear()
    run.missed_ticks = run.ticks = 0
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        run.tick()
    trips_ms = [trip / 1e6 for requests in ledgers for trip in requests.round_trips_ns]
    tally = Tally.of(ledgers).since(before)
    print(f"ticks            {run.ticks} in {seconds:.0f} s, {run.missed_ticks} left out (reported)")
    print(f"tick lateness    {percentiles(run.late_ms)}")
    print(f"round trip       {percentiles(trips_ms)}  (bound p99 {ROUND_TRIP_BOUND_MS} ms)")
    print(f"feedback age     {percentiles(run.age_ms)}  (oldest joint, when the tick reads)")
    print(f"driver's CPU     {percentiles(run.cost_ms)} a tick, read and write")
    print(f"commands         {4 * run.ticks}: {tally}")
    print(f"emulator         {run.emulator.lost_ticks} of its own ticks lost")
    return float(np.percentile(trips_ms, 99)) <= ROUND_TRIP_BOUND_MS and tally.sent == 4 * run.ticks == tally.sum


def fault_times(run: Run, fault: Fault) -> list[float]:
    """From the fault to the tick that sees it, at random phases of the tick, ms."""
    random.seed(1)
    times = []
    for _ in range(FAULT_TRIALS):
        run.emulator.inject(Fault.HEALED)
        run.start()
        joint = random.choice(list(Joint))
        time.sleep(random.uniform(0.0, PERIOD_NS / 1e9))
        began_ns = time.monotonic_ns()
        run.emulator.inject(fault, None if fault is Fault.BUS_OFF else joint, 2)
        seen_ns = began_ns
        while not ACTED_ON[fault](run.tick()[0], time.monotonic_ns()) and seen_ns - began_ns < 1e9:
            seen_ns = time.monotonic_ns()
        times.append((time.monotonic_ns() - began_ns) / 1e6)
        run.emulator.inject(Fault.HEALED)
    return times


def measure(seconds: float) -> bool:
    """Everything, on the virtual bus."""
    device = with_bus(load_exoskeleton(), "virtual", "bench")
    real_time = acquire_real_time()
    sys.setswitchinterval(0.0005)  # emulator and driver share an interpreter here; real drives do not
    print(f"real time        {'SCHED_FIFO' if real_time.fifo else 'no privilege'}")
    with emulating(DriveEmulator(device)) as emulator:
        run = Run(SocketCanJoints(device), emulator)
        disable_gc()
        run.start()
        well = steady(run, seconds)
        for fault in ACTED_ON:
            times = fault_times(run, fault)
            print(
                f"{fault.value:<8} → event {percentiles(times)}  (bound {FAULT_BOUND_MS:.0f} ms, {len(times)} trials)"
            )
            well = well and max(times) <= FAULT_BOUND_MS
        run.emulator.inject(Fault.HEALED)
        run.joints.close(time.monotonic_ns())
    return well


def main() -> int:
    """Ends 0 when every bound is kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--alone", action="store_true", help="without perception beside it")
    parser.add_argument("--home", type=Path, default=None)
    wanted = parser.parse_args()
    if wanted.alone:
        return 0 if measure(wanted.seconds) else 1
    with perception(wanted.home) as rate:
        well = measure(wanted.seconds)
        print(f"perception       {rate():.1f} frames/s beside it")
    return 0 if well else 1


if __name__ == "__main__":
    raise SystemExit(main())
