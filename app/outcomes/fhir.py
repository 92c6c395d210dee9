"""A session's outcomes as an HL7 FHIR R5 bundle: the patient's pseudonym, the device, an Observation a measure.

Units are UCUM's. A measure has LOINC's code only where one says the same; each has its own, in CODES, with its
definition in docs/explanation/outcomes.md. https://hl7.org/fhir/R5/observation.html
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_OID, uuid5

from app.outcomes.guided import last_completed
from app.outcomes.session import SessionOutcomes
from app.outcomes.table import RATINGS, ROWS, TESTS
from app.recording.deidentify import Deidentified
from app.recording.samples import ExportFault
from app.system.errors import AppError
from app.system.files import write_whole
from app.system.program import VERSION, program_identity
from app.text.catalogue import tr
from hal.joints.device import Joint
from logs.reading.errors import cause_of

CODES, PATIENTS, SESSIONS = "urn:rleex:outcome", "urn:rleex:patient", "urn:rleex:session"  # systems of our own codes
UCUM, LOINC = "http://unitsofmeasure.org", "http://loinc.org"
CATEGORIES = "http://terminology.hl7.org/CodeSystem/observation-category"
DEGREE = "deg"
# By our code: LOINC's. Steps have none: its codes name a pedometer.
LOINC_CODES = {
    "pain": ("72514-3", "Pain severity - 0-10 verbal numeric rating [Score] - Reported"),
    "exertion": ("82289-0", "Rating of perceived exertion [Score]"),
}


@dataclass(frozen=True, slots=True)
class _Measure:
    """One Observation: our code, its wording, its value as FHIR has it, and what of the session it covers."""

    code: str
    text: str
    value: dict[str, Any]
    began_s: float  # since the session's first record
    ended_s: float
    category: str = "activity"  # or survey


def bundle_of(found: SessionOutcomes, deidentified: Deidentified | None = None) -> dict[str, Any]:
    """A collection of Patient, Device and Observations; with dates shifted and another name when deidentified."""
    session = deidentified.name if deidentified else found.session
    began = datetime.fromisoformat(found.began)
    if deidentified:
        began += timedelta(microseconds=deidentified.shift_ns / 1000)
    patient, device = (_urn(found.patient, kind) for kind in ("patient", "device"))
    resources = {
        patient: {"resourceType": "Patient", "identifier": [{"system": PATIENTS, "value": found.patient}]},
        device: _device(),
    }
    for one in _measures(found):
        resources[_urn(session, one.code)] = {
            "resourceType": "Observation",
            "identifier": [{"system": SESSIONS, "value": f"{session}/{one.code}"}],
            "status": "final",
            "category": [{"coding": [{"system": CATEGORIES, "code": one.category}]}],
            "code": _code(one),
            "subject": {"reference": patient},
            "effectivePeriod": {
                "start": _text(began + timedelta(seconds=one.began_s)),
                "end": _text(began + timedelta(seconds=one.ended_s)),
            },
            "device": {"reference": device},
            "method": {"coding": [{"system": CODES, "code": found.source.value}]},
            **one.value,
        }
    return {
        "resourceType": "Bundle",
        "type": "collection",
        "identifier": {"system": SESSIONS, "value": session},
        "timestamp": _text(began),
        "entry": [{"fullUrl": urn, "resource": resource} for urn, resource in resources.items()],
    }


def export_bundle(found: SessionOutcomes, folder: Path, deidentified: Deidentified | None = None) -> Path:
    """Write the bundle into a folder, as fhir.resources understands it; the file. Raises AppError."""
    from fhir.resources.bundle import Bundle

    target = folder / f"{deidentified.name if deidentified else found.session}.fhir.json"
    bundle = Bundle.model_validate(bundle_of(found, deidentified))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(target, f"{bundle.model_dump_json(indent=1)}\n".encode())
    except OSError as error:
        raise AppError(ExportFault.UNWRITABLE, path=target, detail=cause_of(error)) from error
    return target


def _measures(found: SessionOutcomes) -> Iterator[_Measure]:
    measures, whole = found.measures, (0.0, found.measured_s)
    for key, field, _ in ROWS:
        value = getattr(measures, field)
        if value is not None:
            yield _Measure(field, tr(f"outcomes.{key}"), _quantity(value, _unit(field)), *whole)
    for joint in Joint:
        motion = measures.range_of_motion.get(joint.name.lower())
        if motion is not None:
            text = tr("outcomes.range", joint=joint)
            bounds = {"low": _quantity_of(motion.low_deg, DEGREE), "high": _quantity_of(motion.high_deg, DEGREE)}
            yield _Measure(f"{joint.name.lower()}_range_of_motion", text, {"valueRange": bounds}, *whole)
    for key, test, field, _ in TESTS:
        result = last_completed(found.tests, test)
        if result is not None and getattr(result, field) is not None:
            ended_s = (result.ended_ns - found.began_ns) / 1e9
            value = _quantity(getattr(result, field), _unit(field))
            yield _Measure(key, tr(f"outcomes.{key}"), value, ended_s - result.duration_s, ended_s)
    for name in RATINGS:
        rating = getattr(found, name)
        if rating is not None:
            yield _Measure(name, tr(f"outcomes.{name}"), {"valueInteger": rating}, *whole, category="survey")


def _device() -> dict[str, Any]:
    """What measured: the exoskeleton's joints by this program; its version is the one that computed the measures."""
    return {
        "resourceType": "Device",
        "name": [{"value": "rleex", "type": "registered-name"}],
        "type": [{"text": "Lower-limb exoskeleton"}],
        "version": [{"value": program_identity()[VERSION]}],
    }


def _code(one: _Measure) -> dict[str, Any]:
    coding = [{"system": CODES, "code": one.code}]
    if one.code in LOINC_CODES:
        code, display = LOINC_CODES[one.code]
        coding.append({"system": LOINC, "code": code, "display": display})
    return {"coding": coding, "text": one.text}


def _quantity(value: float, unit: str) -> dict[str, Any]:
    return {"valueQuantity": _quantity_of(value, unit)}


def _quantity_of(value: float, unit: str) -> dict[str, Any]:
    readable = unit.replace("{", "").replace("}", "")  # UCUM's braces hold what is counted
    return {"value": value, "unit": readable, "system": UCUM, "code": unit}


def _unit(field: str) -> str:
    """UCUM's, from the field's name."""
    ends = {"_steps_min": "{steps}/min", "_m_s": "m/s", "_percent": "%", "_m": "m", "_s": "s"}
    return next((unit for end, unit in ends.items() if field.endswith(end)), "{steps}")


def _urn(subject: str, what: str) -> str:
    """The same for the same thing, so that a second export does not double it."""
    return uuid5(NAMESPACE_OID, f"{CODES}/{subject}/{what}").urn


def _text(moment: datetime) -> str:
    return moment.isoformat(timespec="milliseconds")
