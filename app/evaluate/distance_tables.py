"""The distance evaluations as tables for the terminal.

"near 3", "near 10": share of frames in which the button's distance reads nearer than the truth by over 3, 10 %.
"""

from __future__ import annotations

import math

from rich.table import Table

from app.evaluate.distance_frames import FINDERS, SequenceResult
from app.evaluate.distance_measures import DistanceFigures
from app.evaluate.distance_results import PAPER_TABLE_5, Table5
from app.evaluate.idle import IdleResult
from app.evaluate.press_zone import LOOKS, ZoneRow
from app.evaluate.trigger import CAMERAS, MODES, PAPER_FPS, PAPER_TABLE_6, TriggerRow

FIGURES = ("n", "lost", "MAE", "bias", "p95 cm", "≤ 5 cm", "near 3", "near 10")


def sequence_table(result: SequenceResult) -> Table:
    """Both finders over a labelled sequence, whole and by tilt."""
    table = Table("", *FIGURES, title="Distance on labelled frames")
    for name in FINDERS:
        table.add_row(name, *_cells(result.figures(name)))
        for tilt, one in result.by_tilt(name):
            table.add_row(f"  tilt {tilt}", *_cells(one), style="dim")
        table.add_section()
    return table


def table_5(table: Table5) -> Table:
    """Table 5: error in % over distance."""
    columns = ("cm", "paper", "published", "robust", "worst hand", "D435i paper", "published", "robust", "zeros")
    title = f"Table 5: error in %, {table.hands} digital hands facing a {table.focal_px:g} px camera"
    shown = Table(*columns, title=title, caption="zeros: frames in which the depth map says 0 at the palm")
    for row in table.rows:
        paper, paper_depth = PAPER_TABLE_5[row.distance_cm]
        shown.add_row(
            str(row.distance_cm),
            f"{paper:+.1f}",
            _signed(row.mono_percent["published"]),
            _signed(row.mono_percent["robust"]),
            _signed(row.worst_percent),
            "–" if paper_depth is None else f"{paper_depth:+.1f}",
            _signed(row.depth_percent["published"]),
            _signed(row.depth_percent["robust"]),
            f"{100 * row.depth_zero:.0f} %",
        )
    return shown


def tilt_table(table: Table5) -> Table:
    """What 40° of tilt does."""
    shown = Table(
        "towards",
        "mean error %",
        "median |error| %",
        "p95 %",
        "button near > 3 %",
        title="Robust, tilted by 40°, 20–60 cm",
    )
    for row in table.tilts:
        near = f"{100 * row.near_3:.1f} %"
        shown.add_row(
            f"{row.direction_deg}°",
            f"{row.mean_percent:+.1f}",
            f"{row.median_percent:.1f}",
            f"{row.p95_percent:.1f}",
            near,
        )
    return shown


def walk_table(table: Table5) -> Table:
    """The safety property on random walks."""
    shown = Table("", *FIGURES, title="Random walks: 14–70 cm, tilt to 55°, twelve gestures, uncalibrated")
    for name, one in table.walk.items():
        shown.add_row(name, *_cells(one))
    return shown


def table_6(rows: list[TriggerRow]) -> Table:
    """Table 6: press probability over distance."""
    heads = [f"{camera} {what}" for camera in CAMERAS for what in ("paper", *MODES, "FPS (paper)")]
    shown = Table("cm", *heads, title=f"Table 6: presses in % of {rows[0].changes} posture changes, threshold 20 cm")
    for row in rows:
        cells = []
        for number, camera in enumerate(CAMERAS):
            cells.append(str(PAPER_TABLE_6[row.distance_cm][number]))
            cells.extend(f"{100 * row.pressed[camera, mode]:.0f}" for mode in MODES)
            fps = f"{row.fps[camera]:.0f}" if camera in row.fps else "–"
            cells.append(f"{fps} ({PAPER_FPS[row.distance_cm][number]})")
        shown.add_row(str(row.distance_cm), *cells)
    return shown


def idle_table(result: IdleResult) -> Table:
    """Commands of hands that pressed nothing."""
    title = f"{result.frames:,} simulated frames, noise from {result.noise_frames} frames of MediaPipe"
    shown = Table("", "commands", "presses", "cancelled", title=title)
    for mode in MODES:
        shown.add_row(mode, str(result.commands[mode]), str(result.presses[mode]), str(result.cancels[mode]))
    return shown


def zone_table(rows: list[ZoneRow]) -> Table:
    """How near the hand is followed, and whether a push with the proposed threshold commands."""
    heads = [f"{look}: {what}" for look in LOOKS for what in ("followed to", "commands")]
    shown = Table("lens", "gesture", *heads, title="The press zone on the digital hand, worst hand and share of pushes")
    for row in rows:
        cells = [
            cell for look in LOOKS for cell in (f"{row.followed_cm[look]:.0f} cm", f"{100 * row.commands[look]:.0f} %")
        ]
        shown.add_row(f"{row.focal_px:.0f} px", row.gesture, *cells, end_section=row.gesture == "rock")
    return shown


def _cells(one: DistanceFigures) -> list[str]:
    return [
        str(one.frames),
        str(one.missing),
        f"{one.mae_cm:.2f}",
        f"{one.bias_cm:+.2f}",
        f"{one.p95_cm:.2f}",
        f"{100 * one.within_5cm:.1f}%",
        f"{100 * one.near_3:.2f}%",
        f"{100 * one.near_10:.2f}%",
    ]


def _signed(percent: float) -> str:
    return "–" if math.isnan(percent) else f"{percent:+.1f}"
