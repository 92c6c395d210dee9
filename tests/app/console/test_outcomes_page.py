"""The page of a patient's outcomes: reached by its key, over real trails and a recording."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from app.console.screens.outcomes import OutcomesPage, plot, progress_lines
from app.console.screens.patients import PatientsScreen
from app.console.widgets.panel import Panel
from app.evaluate.outcomes.walks import RecordedWalk, Walk
from app.motion.plan import patient_of
from app.outcomes.change import SMALLEST_CHANGES
from app.outcomes.session import find_outcomes
from app.outcomes.table import Series, series_of
from app.system.paths import Home
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from profiles.schema import DEMO_PATIENT, GaitParameters, Profile
from testing.trails import write_sample
from tests.app.console.conftest import Opener
from tests.app.console.test_sizes import text_of

DEVICE = load_exoskeleton(DEFAULT_DEVICE)


def recorded(home: Path, length_m: float, seed: int) -> Path:
    """A session of the demo patient with a short recorded walk."""
    profile: Profile = msgspec.structs.replace(
        DEMO_PATIENT, gait=GaitParameters(step_time_s=1.6, step_length_m=length_m)
    )
    parameters = {name: value for name, value in msgspec.to_builtins(profile).items() if name != "identifier"}
    trail = write_sample(home, minutes=0.02, seed=seed, patient="demo", parameters=parameters)
    RecordedWalk(patient_of(profile, DEVICE), DEVICE, trail.with_suffix(".mcap")).perform(Walk(strides=1))
    return trail


async def test_a_patients_page_shows_each_measure_over_sessions(console: Opener, home: Home) -> None:
    trails = [recorded(home.root, 0.24, 1), recorded(home.root, 0.36, 2)]
    write_sample(home.root, minutes=0.02, seed=3, patient="somebody-else")
    first, second = (find_outcomes(home.logs, str(trail)).measures for trail in trails)
    async with console(profile=None, size=(130, 40)) as open_console:
        await open_console.shows("demo")
        await open_console.press("m")
        await open_console.shows("Outcomes of patient demo")
        await open_console.shows("2 sessions, ")
        text = open_console.app.screen.query_one("#measures", Panel).text
        assert f"speed, m/s  {first.speed_m_s:.3f} → {second.speed_m_s:.3f}" in text
        assert "minimal important change: ±0.160, not reached" in text
        assert "smallest detectable change: ±0.067, reached" in text  # step lengths
        await open_console.press("escape")
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientsScreen))
        kept = sorted((home.root / "outcomes").iterdir())
        assert [path.stem for path in kept] == [trail.stem for trail in trails]
        kept[0].write_bytes(b"{")  # what was kept and can't be read is measured again
        trails[1].with_suffix(".mcap").write_bytes(b"no recording")
        await open_console.press("m")
        await open_console.shows("1 session, ")
        notes = str(open_console.app.screen.query_one("#notes").render())
        assert f"✗ {trails[1].with_suffix('.mcap')}" in notes
        assert "Tilson" in notes


async def test_a_patient_without_sessions(console: Opener) -> None:
    async with console(profile=None, size=(80, 24)) as open_console:
        await open_console.press("m")
        await open_console.shows("No session of this patient can be measured")
        assert isinstance(open_console.app.screen, OutcomesPage)


async def test_without_a_recording_the_page_says_so(console: Opener, home: Home) -> None:
    write_sample(home.root, minutes=0.02, patient="demo")
    async with console(profile=None, size=(80, 24)) as open_console:
        await open_console.press("m")
        await open_console.shows("1 session, ")
        assert "has no recording" in str(open_console.app.screen.query_one("#notes").render())


def series(*values: float | None, field: str = "") -> Series:
    return Series(name="speed, m/s", form=".2f", values=values, smallest=SMALLEST_CHANGES.get(field))


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ((0.10, 0.30), "speed, m/s  0.10 → 0.30  (+0.20)\nminimal important change: ±0.16, reached"),
        ((0.30, 0.10), "speed, m/s  0.30 → 0.10  (-0.20)\nminimal important change: ±0.16, reached"),
        ((None, 0.30, None, 0.35), "speed, m/s  0.30 → 0.35  (+0.05)\nminimal important change: ±0.16, not reached"),
        ((None, 0.30), "speed, m/s  0.30\nminimal important change: ±0.16"),
    ],
)
def test_the_figures_say_how_far_it_came(values: tuple[float | None, ...], says: str) -> None:
    assert text_of(progress_lines([series(*values, field="speed_m_s")], 72)).startswith(says)


def test_the_curve_rises_with_the_values() -> None:
    lines = text_of(plot(series(0.1, 0.2, 0.3), 40)).split("\n")
    assert len(lines) == 2
    assert lines[0].startswith("0.30")
    assert lines[1].startswith("0.10")
    above, below = (line[5:] for line in lines)
    assert not above[:10].strip(" ⠀")
    assert above[-5:].strip(" ⠀")
    assert below[:10].strip(" ⠀")
    assert not below[-5:].strip(" ⠀")


@pytest.mark.parametrize("width", [0, 5, 23, 24, 40, 200])
def test_any_width_is_kept(width: int) -> None:
    for line in progress_lines([series(0.1, None, 0.3, 0.2, field="speed_m_s"), series(1.0)], width):
        assert len("".join(part for part, _ in line)) <= width


def test_the_scale_reaches_to_the_smallest_change() -> None:
    above, below = text_of(plot(series(0.10, 0.12, field="speed_m_s"), 40)).split("\n")
    assert above.startswith("0.26")  # 0.10 + 0.16; 0.10 - 0.16 is no speed
    assert below.startswith("0.10")


def test_a_measure_that_stays_is_drawn_in_the_middle() -> None:
    lines = text_of(plot(series(0.3, 0.3), 40)).split("\n")
    assert [line[:4].strip() for line in lines] == ["0.30", ""]


def test_what_no_session_has_is_left_out(tmp_path: Path) -> None:
    found = [find_outcomes(tmp_path / "logs", str(write_sample(tmp_path, minutes=0.2, patient="demo")))]
    assert [one.name for one in series_of(found)] == ["steps", "walking time, s", "discomfort, 0 to 10"]
