"""New and edit: every field checked while it is typed, the palm estimate and the step drawn beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import ClassVar

import msgspec
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Input, Label, Select, Static

from app.console.patient_fields import FIELDS, SECTIONS, Field, Kind, Parsed, parse, to_texts
from app.console.screens.base import ConsoleScreen
from app.console.screens.dialogs import ask
from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Lines, content_of
from app.console.widgets.patient_details import field_name
from app.console.widgets.text_field import TextField
from app.text.catalogue import render, tr
from logs.reason import Reason
from profiles.anthropometry import estimate_palm
from profiles.schema import GaitParameters, Profile, Sex

MAX_TYPED = 20_000  # a paste beyond it is refused by the field itself

NEW_PATIENT = Profile(identifier="new", sex=Sex.FEMALE, stature_m=1.65, mass_kg=65.0)

Point = tuple[float, float]
Stroke = Callable[[Point, Point], None]

# A step: points in metres, x forward, y up.
VIEW_M = 2.0  # across
FOOT_M = 0.16


class PatientForm(ConsoleScreen):
    """One patient's profile. Ctrl-S saves, Escape leaves, asking when something would be lost."""

    HELP_PAGE = "form"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "save", "bind.form.save"),
        Binding("f6", "calibrate", "bind.form.calibrate"),
        Binding("escape", "leave_form", "bind.form.leave"),
    ]

    def __init__(self, profile: Profile | None = None) -> None:
        super().__init__()
        self._new = profile is None
        self._base = profile or NEW_PATIENT
        self._saved = to_texts(self._base)
        if self._new:
            self._saved["identifier"] = ""
        self._typed = dict(self._saved)

    def compose(self) -> ComposeResult:
        yield Label(tr("form.title_new") if self._new else tr("form.title", name=self._base.identifier), id="title")
        with Horizontal(id="form"):
            with VerticalScroll(id="fields", can_focus=False):
                for section, fields in SECTIONS.items():
                    yield Label(tr(f"form.section.{section}"), classes="section")
                    for field in fields:
                        yield from self._row(field)
            with Vertical(id="beside"):
                yield Static(id="verdict", markup=False)
                yield Static(id="drawing", markup=False)
                yield Static(id="estimate", markup=False)
        yield from self.compose_bottom()

    def on_mount(self) -> None:
        self.fill()
        self.query_one("#stature_m" if not self._new else "#identifier").focus()

    def fill(self) -> None:
        """Verdict, drawing, estimates."""
        self._check()

    def on_resize(self) -> None:
        self.call_after_refresh(self._check)

    def on_input_changed(self, event: Input.Changed) -> None:
        self._field_changed(event.input.id, event.value)

    def on_select_changed(self, event: Select.Changed) -> None:
        self._field_changed(event.select.id, str(event.value))

    def action_save(self) -> None:
        """Save when everything is right; else show what is not."""
        with self.notify_errors():
            parsed = self._changed()
            if parsed.profile is None:
                self._show(parsed)
                first = next(field for field in FIELDS if field.path in parsed.errors)
                self.query_one(f"#{first.id}").focus()
                self.notify(tr("form.not_saved"), severity="error")
                return
            self._save(parsed.profile)
            self.dismiss()

    async def action_calibrate(self) -> None:
        """The saved patient before the camera; what is typed and not yet saved would be lost under it."""
        if self._new or self._typed != self._saved:
            self.notify(tr("form.save_first"), severity="warning")
            return
        self.dismiss()
        await self.console_app.calibrate(self._base)

    def keep(self) -> bool:
        return self._typed == self._saved

    def action_leave_form(self) -> None:
        """Leave; ask first when something was typed."""
        if self.keep():
            self.dismiss()
        else:
            ask(self.app, lambda: tr("form.leave_title"), lambda: tr("form.leave_text"), self.action_dismiss)

    def _row(self, field: Field) -> ComposeResult:
        with Horizontal(classes="row"):
            unit = f" ({field.unit})" if field.unit else ""
            yield Label(tr(f"field.{field.path}") + unit, classes="name")
            yield self._control(field)
        yield Label("", id=f"{field.id}-error", classes="error", markup=False)

    def _control(self, field: Field) -> Input | Select[str]:
        text = self._saved[field.path]
        if field.kind is Kind.CHOICE:
            assert field.choices is not None
            options = [(tr(one), str(one.value)) for one in field.choices]
            return Select(options, value=text, allow_blank=False, id=field.id, compact=True)
        locked = field.path == "identifier" and not self._new
        return TextField(text, id=field.id, compact=True, max_length=MAX_TYPED, disabled=locked)

    def _field_changed(self, widget: str | None, value: str) -> None:
        field = next((one for one in FIELDS if one.id == widget), None)
        if field is not None and self._typed[field.path] != value:
            self._typed[field.path] = value
            self._check()

    def _check(self) -> None:
        self._show(parse(self._typed, self._base))

    def _show(self, parsed: Parsed) -> None:
        for field in FIELDS:
            label = self.query_one(f"#{field.id}-error", Label)
            error = parsed.errors.get(field.path)
            label.display = error is not None
            label.update("" if error is None else f"✗ {render(labelled(error))}")
        verdict = tr("form.good") if parsed.profile else tr("form.wrong", count=len(parsed.errors))
        self.query_one("#verdict", Static).update(verdict)
        drawable = parse({**self._typed, "identifier": NEW_PATIENT.identifier, "note": ""}, self._base)
        if drawable.profile is not None:
            self._show_profile(drawable.profile)

    def _show_profile(self, profile: Profile) -> None:
        palm = estimate_palm(profile.sex, profile.stature_m, profile.palm.population)
        lines = [tr("form.estimate", width_m=palm.width_m, sd_m=palm.sd_m, error=palm.distance_error)]
        if profile.palm.measured_width_m is not None:
            lines.append(tr("form.measured", width_m=profile.palm.measured_width_m))
        if profile.calibrations:
            lines.append(tr("form.calibrated", camera=profile.calibrations[-1].camera))
        self.query_one("#estimate", Static).update("\n".join(lines))
        self.query_one("#drawing", Static).update(content_of(draw_step(profile, *self._drawing_size())))

    def _drawing_size(self) -> tuple[int, int]:
        """Columns and rows for the drawing, whose parts need about four to one."""
        columns = max(20, min(60, self.query_one("#beside").content_size.width))
        return columns, max(5, columns // 4)

    def _changed(self) -> Parsed:
        """What was typed, in the profile as it is now: a calibration or another person may have changed the rest."""
        if self._new:
            return parse(self._typed, self._base)
        typed = {path: text for path, text in self._typed.items() if text != self._saved[path]}
        return parse(typed, self.console_app.store.load(self._base.identifier))

    def _save(self, profile: Profile) -> None:
        store, now = self.console_app.store, datetime.now(UTC)
        by = self.console_app.authority
        if self._new:
            store.create(profile, by=by, at=now)
        else:
            store.save(profile, by=by, at=now)


def labelled(error: Reason) -> Reason:
    """With the field's label in place of its name in the file."""
    if "field" not in error.values:
        return error
    return msgspec.structs.replace(error, values={**error.values, "field": field_name(str(error.values["field"]))})


def draw_step(profile: Profile, columns: int, rows: int) -> Lines:
    """The level step on the left; stair, obstacle and chair to scale on the right."""
    from hal.joints.body import average_body  # numpy: not before the first paint

    canvas = Canvas(columns, rows)
    limbs = average_body(profile.stature_m, profile.mass_kg)
    thigh_m, shank_m = profile.thigh_length_m or limbs.thigh_m, profile.shank_length_m or limbs.shank_m
    scale = min(canvas.width / VIEW_M, canvas.height / (1.12 * (thigh_m + shank_m)))

    def line(a: Point, b: Point) -> None:
        canvas.line(
            round(a[0] * scale),
            canvas.height - 1 - round(a[1] * scale),
            round(b[0] * scale),
            canvas.height - 1 - round(b[1] * scale),
        )

    gait = profile.gait
    line((0.0, 0.0), (canvas.width / scale, 0.0))
    _legs(line, gait, thigh_m, shank_m)
    x = 0.95
    _box(line, x, gait.stair_rise_m, gait.stair_tread_m)
    _box(line, x + gait.stair_tread_m, 2 * gait.stair_rise_m, gait.stair_tread_m)
    x += 2 * gait.stair_tread_m + 0.12
    _box(line, x, gait.obstacle_height_m, gait.obstacle_depth_m)
    return canvas.lines()


def _legs(line: Stroke, gait: GaitParameters, thigh: float, shank: float) -> None:
    step = gait.step_length_m
    back, front = 0.08, 0.08 + step
    hip = ((back + front) / 2, math.sqrt(max(0.05, (0.99 * (thigh + shank)) ** 2 - (step / 2) ** 2)))
    for foot in (back, front):
        knee = _knee(hip, (foot, 0.0), thigh, shank)
        line(hip, knee)
        line(knee, (foot, 0.0))
        line((foot, 0.01), (foot + FOOT_M * 0.6, 0.01))
    previous = (back, 0.0)
    for index in range(1, 17):
        share = index / 16
        here = (back + step * share, gait.swing_clearance_m * math.sin(math.pi * share))
        if index % 2:
            line(previous, here)
        previous = here


def _knee(hip: Point, ankle: Point, thigh: float, shank: float) -> Point:
    dx, dy = ankle[0] - hip[0], ankle[1] - hip[1]
    reach = min(math.hypot(dx, dy), 0.999 * (thigh + shank))
    along = (thigh**2 - shank**2 + reach**2) / (2 * reach)
    out = math.sqrt(max(0.0, thigh**2 - along**2))
    ux, uy = dx / reach, dy / reach
    return hip[0] + ux * along - uy * out, hip[1] + uy * along + ux * out


def _box(line: Stroke, x: float, height: float, depth: float) -> None:
    line((x, 0.0), (x, height))
    line((x, height), (x + depth, height))
    line((x + depth, height), (x + depth, 0.0))
