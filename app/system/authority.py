"""Whose change it is: an `Authority` knows operator and role, and only signing in makes one.

Every function that changes a patient, a calibration, the configuration, an operator, a joint or a comment, and what
starts real joints, requires one and asks it. What it allows it records first, signed and chained, in the home's
journal of changes: a change that is not on record is not made.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import InitVar, dataclass
from enum import Enum
from typing import Any

from app.system.config import Config, JointsConfig, load_config
from app.system.errors import AppError
from app.system.journals import append_to_journal
from app.system.operators import PERMISSIONS, Operator, Permission, Role, load_store, needs_sign_in
from app.system.paths import Home
from app.system.sign_in import SignInResult, try_pin
from logs.reason import Reason
from logs.records import Change
from profiles.store import Change as ProfileChange
from profiles.store import ChangeCause


class AuthorityFault(Enum):
    """Why a change is refused."""

    NOT_ALLOWED = "not allowed"  # name, role, permission
    NOT_BY_TOKEN = "not by token"  # permission
    SIGN_IN_NEEDED = "sign-in needed"
    NO_OPERATORS = "no operators"


class Proof(Enum):
    """How somebody has shown who they are."""

    PIN = "pin"
    TOKEN = "token"
    NONE = "none"  # nobody is enrolled, nothing real can move: unsigned


class Subject(Enum):
    """What a change is made to."""

    PATIENT = "patient"
    CALIBRATION = "calibration"
    CONFIGURATION = "configuration"
    OPERATOR = "operator"
    JOINT = "joint"
    RECORDING = "recording"


# Fields of a profile (as in files) that calibrating changes; all others are the patient's.
CALIBRATED_FIELDS = frozenset({"calibrations", "press_threshold_cm"})
NOTE_CHANGED = ("…", "…")  # it may hold a name: only that it changed is on record
DEMONSTRATION = "demonstration"  # role in the trail: no operator, no rights
UNSIGNED = frozenset(Permission) - {Permission.MANAGE_OPERATORS}
CAUSES = frozenset(cause.key for cause in ChangeCause)
_BY_SIGNING_IN = object()


@dataclass(frozen=True, slots=True, kw_only=True)
class Authority:
    """Somebody who has signed in, what they may do, and the home whose journal records what they change."""

    home: Home
    name: str  # empty: unsigned
    role: Role | None  # None: unsigned, or a demonstration
    permissions: frozenset[Permission]
    proof: Proof
    origin: InitVar[object]

    def __post_init__(self, origin: object) -> None:
        if origin is not _BY_SIGNING_IN:
            raise TypeError("only a sign-in makes an authority")

    @property
    def role_name(self) -> str:
        """As records have it."""
        return self.role.value if self.role else DEMONSTRATION if self.name else ""

    def may(self, permission: Permission) -> bool:
        """Whether they may."""
        return permission in self.permissions

    def require(self, permission: Permission) -> None:
        """Raises AppError when they may not."""
        if self.may(permission):
            return
        if self.proof is Proof.TOKEN:
            raise AppError(AuthorityFault.NOT_BY_TOKEN, permission=permission)
        if self.proof is Proof.NONE:
            raise AppError(AuthorityFault.SIGN_IN_NEEDED)
        raise AppError(AuthorityFault.NOT_ALLOWED, name=self.name, role=self.role, permission=permission)

    def change(
        self,
        permission: Permission,
        subject: Subject,
        name: str,
        values: Mapping[str, tuple[Any, Any]],
        why: Reason | str | None = None,
    ) -> None:
        """Allow a change and put it on record, before it is made; values: field → before and after.

        Raises AppError when they may not, AuditError when it can't be recorded.
        """
        self.require(permission)
        self.record_own(subject, name, values, why)

    def change_profile(self, patient: str, change: ProfileChange) -> None:
        """Allow and record a change of a patient's profile: `profiles.store.Author`."""
        calibration = CALIBRATED_FIELDS.issuperset(change.changes)
        permission = Permission.CALIBRATE if calibration else Permission.EDIT_PATIENTS
        subject = Subject.CALIBRATION if calibration else Subject.PATIENT
        values = {field: NOTE_CHANGED if field == "note" else both for field, both in change.changes.items()}
        self.change(permission, subject, patient, values, Reason(change.why) if change.why in CAUSES else change.why)

    def record_own(
        self, subject: Subject, name: str, values: Mapping[str, tuple[Any, Any]], why: Reason | str | None
    ) -> None:
        """Into the journal of changes, signed, what needs no permission. Raises AuditError when it can't be."""
        change = Change(
            subject=subject.value,
            name=name,
            values=dict(values),
            reason=why,
            role=self.role_name,
            proof=self.proof.value,
        )
        append_to_journal(self.home, change, self.name)


def sign_in_by_pin(
    home: Home, name: str, pin: str, now_s: float | None = None
) -> tuple[Authority | None, SignInResult]:
    """Try a name and a PIN, and keep the count of wrong ones. The caller records the outcome. Raises AppError."""
    result = try_pin(home.keys, name, pin, time.time() if now_s is None else now_s)
    if result.operator is None:
        return None, result
    return of_operator(home, result.operator, Proof.PIN), result


def of_operator(home: Home, operator: Operator, proof: Proof, limit: frozenset[Permission] | None = None) -> Authority:
    """What a proven operator may do; limit: no more than this. For sign-ins by PIN and token only."""
    permissions = PERMISSIONS[operator.role]
    return Authority(
        home=home,
        name=operator.name,
        role=operator.role,
        permissions=permissions if limit is None else permissions & limit,
        proof=proof,
        origin=_BY_SIGNING_IN,
    )


def unsigned(home: Home, config: Config | None = None) -> Authority:
    """Who works unsigned, where nobody is enrolled and nothing real is configured.

    config: the one in use, if it is not the home's. Raises AppError where a sign-in is needed.
    """
    real = any(needs_sign_in(one) for one in (load_config(home.config), config) if one is not None)
    if load_store(home.keys).operators:
        raise AppError(AuthorityFault.SIGN_IN_NEEDED)
    if real:
        raise AppError(AuthorityFault.NO_OPERATORS)
    return Authority(home=home, name="", role=None, permissions=UNSIGNED, proof=Proof.NONE, origin=_BY_SIGNING_IN)


def demonstration(home: Home, joints: JointsConfig, name: str = "demo") -> Authority:
    """Who moves simulated joints or emulated drives without a sign-in, and nothing else. Raises AppError.

    Joints of another computer: that one refuses to move others for whom nobody has signed in.
    """
    if not joints.emulated:
        raise AppError(AuthorityFault.SIGN_IN_NEEDED)
    operate = frozenset({Permission.OPERATE})
    return Authority(home=home, name=name, role=None, permissions=operate, proof=Proof.NONE, origin=_BY_SIGNING_IN)
