"""The planner process: requests in, checked plans out. Planning takes milliseconds that a tick does not have."""

from __future__ import annotations

from app.ipc.links import OrderedReceiver, OrderedSender, address
from app.ipc.states import GaitState
from app.ipc.streams import PLAN_REPLY, PLAN_REQUEST
from app.motion.plan import Patient, PlanRequest, encode_array, patient_of
from app.motion.trajectory import RECIPES, plan
from app.system.config import SessionSetup, load_device
from app.system.scheduling import gc_freeze, lock_touched_memory, set_scheduling

WAIT_S = 0.2  # between checks that the console still runs


def run_planner(setup: SessionSetup) -> None:
    """Answer every request until the session ends."""
    device = load_device(setup.config.joints)
    patient = patient_of(setup.profile, device)
    requests = OrderedReceiver(address(setup.links, PLAN_REQUEST.name), PlanRequest)
    replies = OrderedSender(address(setup.links, PLAN_REPLY.name), enc_hook=encode_array)
    warm_up(patient)
    gc_freeze()
    set_scheduling("planner")
    lock_touched_memory()
    while not setup.orphaned:
        request = requests.receive(WAIT_S)
        if request is not None:
            replies.send(plan(request, patient))
    requests.close()
    replies.close()


def warm_up(patient: Patient) -> None:
    """Plan every movement once: fills the caches before the first request."""
    for action, phase in RECIPES:
        request = PlanRequest(
            number=0, action=action, phase=phase, from_state=GaitState.STANDING, start_rad=(0.0, 0.0, 0.0, 0.0)
        )
        plan(request, patient)
