"""f asks for the patient's consent before the camera's pictures are recorded, and withdraws it; a mark says it runs."""

from __future__ import annotations

import os

import pytest
from msgspec.structs import replace

from app.console.screens import session
from app.console.screens.hand_keys import HandKeys
from app.ipc.messages import PerceptionCommand
from app.session.setup import make_setup
from app.system.config import Config, RecordingConfig
from app.system.paths import Home, pictures_path
from app.text.catalogue import tr
from logs.records import Body, Recording
from profiles.schema import DEMO_PATIENT, Profile
from testing.trails import write_sample
from tests.app.console.conftest import Console, Opener

RECORDED = Config(recording=RecordingConfig(on=True))


def asked(opened: Console) -> list[bool]:
    """What perception was told of pictures."""
    commands = opened.host.perception_commands
    return [one.record_pictures for one in commands if one.record_pictures is not None]


def consents(trail: list[Body]) -> list[tuple[bool, bool, str]]:
    return [(one.on, one.consent, one.path) for one in trail if isinstance(one, Recording)]


def perception_says(opened: Console, recorded: bool, incarnation: int = 1) -> None:
    """In its reports from now on."""
    state = opened.app.live_state()
    assert state is not None
    assert state.report is not None
    opened.host.message = replace(state.report, pictures_recorded=recorded, incarnation=incarnation)


def newest_incarnation(opened: Console) -> int:
    """Of perception, as far as the console knows."""
    state = opened.app.live_state()
    assert state is not None
    assert state.report is not None
    return state.report.incarnation


async def agree(opened: Console) -> None:
    """The patient agrees."""
    await opened.press("f")
    await opened.shows(tr("pictures.consent.title"))
    await opened.press("y")
    await opened.until(lambda: asked(opened) == [True])


async def test_with_a_yes_pictures_are_recorded_and_with_the_next_deleted(console: Opener, trail: list[Body]) -> None:
    async with console(config=RECORDED, size=(120, 36)) as opened:
        name = f"{opened.host.setup.session}.pictures.mcap"
        assert tr("status.pictures") not in opened.text()
        await opened.press("f")
        await opened.shows(tr("pictures.consent.title"))
        await opened.press("y")
        await opened.until(lambda: asked(opened) == [True])
        assert consents(trail) == [(True, True, name)]
        perception_says(opened, True)
        await opened.shows(f"● {tr('status.pictures')}")
        await opened.press("f")
        await opened.shows(tr("pictures.withdraw.title"))
        await opened.press("y")
        await opened.until(lambda: asked(opened) == [True, False])
        assert consents(trail) == [(True, True, name), (False, False, name)]
        await opened.tells(tr("pictures.deleted"))
        perception_says(opened, False)
        await opened.until(lambda: tr("status.pictures") not in opened.text())


async def test_a_restarted_perception_is_told_of_the_consent_and_the_pictures_size(
    console: Opener, trail: list[Body]
) -> None:
    async with console(config=RECORDED, size=(120, 36)) as opened:
        await agree(opened)
        perception_says(opened, True)
        await opened.shows(f"● {tr('status.pictures')}")
        commands = opened.host.perception_commands
        size = [one for one in commands if one.preview_hz is not None][-1]
        commands.clear()
        perception_says(opened, False, incarnation=2)
        await opened.until(lambda: asked(opened) and size in commands)
        perception_says(opened, True, incarnation=2)
        await opened.shows(f"● {tr('status.pictures')}")
        assert asked(opened) == [True]
        assert len(consents(trail)) == 1, "the consent is one"


async def test_a_consent_can_be_withdrawn_while_perception_is_down(console: Opener, trail: list[Body]) -> None:
    async with console(config=RECORDED, size=(120, 36)) as opened:
        await agree(opened)  # perception ends before it has said that it records
        await opened.press("f")
        await opened.shows(tr("pictures.withdraw.title"))
        await opened.press("y")
        await opened.until(lambda: asked(opened) == [True, False])
        assert [consent for _, consent, _ in consents(trail)] == [True, False]
        perception_says(opened, False, incarnation=2)
        await opened.until(lambda: newest_incarnation(opened) == 2)
        assert asked(opened) == [True, False], "nothing is left to be told again"


async def test_a_consent_given_before_this_console_took_over_holds_for_a_restarted_perception(
    console: Opener, trail: list[Body]
) -> None:
    async with console(config=RECORDED, size=(120, 36)) as opened:
        perception_says(opened, True)
        await opened.shows(f"● {tr('status.pictures')}")
        perception_says(opened, False, incarnation=2)
        await opened.until(lambda: asked(opened) == [True])
        await opened.press("f")
        await opened.shows(tr("pictures.withdraw.title"))


@pytest.mark.parametrize(("profile", "key"), [(None, "t"), (None, "g"), (DEMO_PATIENT, "v")])
async def test_every_screen_asks_a_restarted_perception_for_its_pictures_size(
    console: Opener, profile: Profile | None, key: str
) -> None:
    """Of training, enrolment and comparison."""
    async with console(profile=profile, size=(120, 36)) as opened:
        await opened.press(key)
        await opened.until(lambda: isinstance(opened.app.screen, HandKeys) and opened.app.screen.composed)
        await opened.until(lambda: (state := opened.app.live_state()) and state.report and state.preview)
        await opened.pilot.pause()
        commands = opened.host.perception_commands
        size = [one for one in commands if one.preview_hz is not None][-1]
        commands.clear()
        perception_says(opened, False, incarnation=2)
        await opened.until(lambda: commands)
        assert commands == [size]


@pytest.mark.parametrize(("consent", "asks"), [(True, "withdraw"), (False, "consent"), (None, "consent")])
async def test_what_was_agreed_before_a_takeover_is_taken_from_the_trail(
    console: Opener, home: Home, consent: bool | None, asks: str
) -> None:
    """Perception was restarted meanwhile, so that it records nothing."""
    answers = {None: (), True: (True,), False: (True, False)}[consent]
    trail = write_sample(home.root, 0.1, of_console=[Recording(on=one, consent=one, path="p") for one in answers])
    setup = make_setup(home, RECORDED, DEMO_PATIENT, None)
    held = replace(setup, session=trail.stem, host_pid=os.getpid())
    async with console(config=RECORDED, held=held, size=(120, 36)) as opened:
        await opened.until(lambda: (state := opened.app.live_state()) and state.report)
        await opened.until(lambda: opened.app.trail._sink is not None)
        await opened.press("f")
        await opened.shows(tr(f"pictures.{asks}.title"))
        await opened.until(lambda: asked(opened) == ([True] if consent else []))


@pytest.mark.parametrize("answer", ["n", "escape"])
async def test_without_a_yes_nothing_changes(console: Opener, trail: list[Body], answer: str) -> None:
    async with console(config=RECORDED) as opened:
        await opened.press("f")
        await opened.shows(tr("pictures.consent.title"))
        await opened.press(answer)
        await opened.until(lambda: tr("pictures.consent.title") not in opened.text())
        assert (asked(opened), consents(trail)) == ([], [])


async def test_pictures_that_stay_are_told(console: Opener, trail: list[Body], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "DELETED_POLLS", 2)
    async with console(config=RECORDED, size=(120, 36)) as opened:
        path = pictures_path(opened.app.home.logs, opened.host.setup.session)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()  # nobody deletes it: the recording's process is gone
        perception_says(opened, True)
        await opened.shows(f"● {tr('status.pictures')}")
        await opened.press("f", "y")
        await opened.tells("rleex recording delete-pictures last")


async def test_a_session_that_is_not_recorded_says_how(console: Opener, trail: list[Body]) -> None:
    async with console() as opened:
        await opened.press("f")
        await opened.tells("rleex configure recording.on=true")
        assert (asked(opened), consents(trail)) == ([], [])


async def test_an_observer_records_nothing(console: Opener, trail: list[Body]) -> None:
    async with console(config=RECORDED, read_only=True) as opened:
        await opened.press("f", "y")
        assert (asked(opened), consents(trail)) == ([], [])
        assert PerceptionCommand(record_pictures=True) not in opened.host.perception_commands
