"""The console from its start to its exit status: which session it begins with, and what it leaves behind."""

from __future__ import annotations

import sys

from app.console.app import ConsoleApp
from app.console.observer import ObserverHost
from app.link.wire import LinkFault
from app.session.shared import held_session, shared
from app.system.config import Config, SessionSetup
from app.system.errors import AppError
from app.system.operators import needs_sign_in
from app.system.paths import Home
from app.system.scheduling import autogroup_nice, set_scheduling
from app.text.catalogue import tr
from profiles.store import ProfileStore


def run_console(home: Home, config: Config, *, straight: bool = False, read_only: bool = False) -> None:
    """Run the console until its operator leaves.

    straight: begin with the configured patient's session; so does a console that only simulates, because then
    nothing can happen to anybody. A session of this home whose console is gone is taken over instead.
    Raises AppError or ProfileError for what configuration or profile gets wrong; AppError as well where the session is
    held for a laptop.
    """
    if read_only:
        observe(home, config)
        return
    held = held_session(home)  # with what was chosen for it; the next session is begun with what is configured
    if held is not None and held.linked:  # its leases are those of `rleex joints`: control would hear no console here
        raise AppError(LinkFault.HELD_FOR_LAPTOP, session=held.session)
    simulated = not needs_sign_in(config)
    profile = ProfileStore(home.profiles).load(config.patient) if (straight or simulated) and not held else None
    app = ConsoleApp(home, config, profile=profile, held=held)
    set_scheduling("console")
    left = False
    try:
        with autogroup_nice("console"):
            app.run()
        left = not app.return_code
    finally:
        if left:
            app.close_live()
            if app.switch.left_on:  # its bar is gone
                sys.stderr.write(f"{tr('stop.left_on')}\n")
            if app.left_held and held is not None:
                sys.stderr.write(f"{tr('console.left_held', limit_s=held.config.unattended_s)}\n")
        elif app.live is not None:  # a defect of the console ends no session: another console takes it over
            limit_s = app.live.host.setup.config.unattended_s
            app.leave_live()
            sys.stderr.write(f"{tr('console.left', limit_s=limit_s)}\n")
        app.trail.keep(home)
    if app.return_code:
        raise SystemExit(app.return_code)


def observe(home: Home, config: Config) -> None:
    """Show the running session of this home. Raises AppError when there is none."""
    set_scheduling("observer")
    setup = shared(home)

    def make_host(made: SessionSetup) -> ObserverHost:
        made.links.path.rmdir()  # an observer has no links of its own
        return ObserverHost(setup)

    app = ConsoleApp(home, config, profile=setup.profile, make_host=make_host, read_only=True)
    try:
        app.run()
    finally:
        app.close_live()
