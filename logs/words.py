"""Every kind of record in a line for people. A new kind is a new row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from logs import records as r
from logs.records import Body

# Fields in braces; None reads "–", lists are joined, angles of joints are turned into degrees below.
SENTENCES: dict[type, str] = {
    r.SessionStart: "session begins, rleex {versions[rleex]}, simulated: {simulated}",
    r.SessionEnd: "session ends: {reason}",
    r.ProcessStart: "process starts (pid {pid})",
    r.ProcessEnd: "process ends {ended} {reason}",
    r.PatientChosen: "patient {patient}",
    r.PatientConfirmed: "patient {patient} confirmed",
    r.SignIn: "{name} signs in as {role}",
    r.SignOut: "{name} signs out: {reason}",
    r.SignInFailed: "sign-in of {name} refused ({failures} in a row): {reason}",
    r.OperatorChanged: "operator {name} ({role}): {change}",
    r.Camera: "camera {camera}: {width_px}×{height_px}, f {focal_px:.0f} px, {intrinsics_source}",
    r.Calibration: "palm anchor {anchor_m} m, {method} {text}",
    r.Recording: "recording on: {on}, consent noted: {consent} {path}",
    r.GestureOnset: "gesture {gesture}, confidence {confidence:.2f} {explanation}",
    r.Press: "pressed with {gesture} at {distance_m} m (threshold {threshold_m} m)",
    r.Cancel: "press cancelled: {reason}",
    r.Release: "released: {gesture}",
    r.Command: "{action} (#{number}) by {source}, gesture {gesture}, from {state}",
    r.Refusal: "refused {action} by {source}: {reason}",
    r.GuardRefusal: "guard refused {joint} {quantity} {value} (limit {limit}): {reason}",
    r.PlanChecked: "plan #{number} {action}, {phase}, {duration_s:.2f} s, passes: {ok} {reason}",
    r.Transition: "{from_state} → {to_state} ({action})",
    r.ActionEnd: "{action} (#{number}) {outcome} {reason}",
    r.EventRaised: "{event} → {effect}: {text}",
    r.EventCleared: "{event} gone after {lasted_s:.1f} s",
    r.EffectChanged: "effect {from_effect} → {to_effect}",
    r.Acknowledgement: "acknowledged after {waited_s:.1f} s: {events} {reason}",
    r.Stop: "STOP in {state} → {effect}",
    r.Arming: "armed: {armed} {reason}",
    r.Drives: "drives {state} {detail}",
    r.JointStatistics: "angles {angle_mean_rad}, temperature {temperature_c} °C",
    r.TickLateness: "ticks {ticks}, missed {missed}, late p99 {p99_ms:.3f} ms, most {max_ms:.3f} ms",
    r.RealTimePrivilege: "real-time: FIFO {fifo}, memory locked {memory_locked}, core {core}, kept awake {cores_awake}",
    r.HeartbeatLost: "no sign of life of {stream} for {age_ms:.0f} ms",
    r.HeartbeatFound: "sign of life of {stream} again after {silent_ms:.0f} ms",
    r.ClockStep: "wall clock moved by {step_s:+.3f} s",
    r.RecordsLost: "{count} records lost: {reason}",
    r.Note: "note: {text}",
    r.Discomfort: "discomfort {rating}/10 {text}",
    r.Checkpoint: "signed checkpoint over {records} records, closing: {closing}",
    r.LogOpened: "{file} opened",
    r.LogClosed: "{file} closed with {records} records",
    r.LogRecovered: "{file} found unclosed: {text}",
    r.Comment: "comment on record {about_sequence}: {text}",
}

# For colours and for what a reader looks for first; everything else is plain.
WEIGHT: dict[type, str] = {
    r.Stop: "grave",
    r.EventRaised: "grave",
    r.GuardRefusal: "grave",
    r.RecordsLost: "grave",
    r.HeartbeatLost: "grave",
    r.ClockStep: "grave",
    r.SignInFailed: "grave",
    r.Refusal: "caution",
    r.Cancel: "caution",
    r.Command: "action",
    r.Transition: "action",
    r.ActionEnd: "action",
    r.Acknowledgement: "action",
    r.JointStatistics: "faint",
    r.TickLateness: "faint",
    r.Checkpoint: "faint",
}


def kind_of(body: Body) -> str:
    """The kind as it stands in the file."""
    return str(type(body).__struct_config__.tag)


def sentence(body: Body) -> str:
    """The record in a line; not yet harmless for a terminal."""
    values = {name: _plain(name, value) for name, value in msgspec.structs.asdict(body).items()}
    try:
        return SENTENCES[type(body)].format_map(values).strip()
    except (KeyError, ValueError, TypeError):  # a version that is not named, a null where a number was expected
        return ", ".join(f"{name} {value}" for name, value in values.items())


def _plain(name: str, value: Any) -> Any:
    if value is None:
        return "–"
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, Mapping) or not isinstance(value, tuple):
        return value
    if name.endswith("_rad"):
        return " ".join("–" if each is None else f"{math.degrees(each):.1f}°" for each in value)
    return " ".join("–" if each is None else f"{each:.1f}" if isinstance(each, float) else str(each) for each in value)
