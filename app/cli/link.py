"""rleex link: which laptop and which exoskeleton's computer know each other."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from app.cli.common import PORT, HomeOption, print_text, refuse_options
from app.cli.permission import sign_in
from app.system.errors import AppError
from app.system.operators import Permission
from app.system.paths import Home, find_home, is_held
from app.text.catalogue import tr
from logs.reason import sanitize_terminal

cli = typer.Typer(no_args_is_help=True)
POLL_S = 0.2


@cli.command()
def pair(
    host: Annotated[
        str, typer.Argument(help="On the laptop: the exoskeleton's computer, e.g. exo.local:7447. There: leave it out.")
    ] = "",
    code: Annotated[str, typer.Option(help="The code that the exoskeleton's computer shows; else it is asked.")] = "",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Of rleex joints, where HOST names none.")] = PORT,
    home: HomeOption = None,
) -> None:
    """Pair laptop and exoskeleton's computer: the latter shows a code, which is typed at the laptop.

    On both an engineer signs in first.
    """
    if ":" in host:
        refuse_options(f"link pair {host}", {"--port": port != PORT})
    if not host:
        refuse_options("link pair", {"--code": code})
    place = find_home(home)
    sign_in(home, Permission.CONFIGURE)
    if host:
        _pair_laptop(place, host if ":" in host or port == PORT else f"{host}:{port}", code)
    else:
        _show_code(place, port)


def _pair_laptop(place: Home, host: str, code: str) -> None:
    from app.link import pairing
    from app.link.questions import check_version, find

    found = find(host)
    check_version(host, found.link, found.program)
    peer = pairing.pair(place, host, code or typer.prompt(tr("cli.link.ask_code")), time.time())
    print_text("cli.link.paired", name=sanitize_terminal(peer.name))


def _show_code(place: Home, port: int) -> None:
    from app.link import pairing
    from app.link.keys import peers_of
    from app.link.questions import find
    from app.link.wire import LinkFault

    try:
        find(f"127.0.0.1:{port}", limit_s=1.0)
    except AppError as error:
        raise AppError(LinkFault.NO_SERVICE, home=place.root, port=port) from error
    if not is_held(place):  # what answers has another home, and would look for the offer there
        raise AppError(LinkFault.NO_SERVICE, home=place.root, port=port)
    code, before = pairing.new_code(), peers_of(place)
    pairing.write_offer(place, pairing.Offer(code=code, expires_s=time.time() + pairing.LASTS_S))
    suffix = "" if port == PORT else f":{port}"
    print_text("cli.link.code", code=code, minutes=int(pairing.LASTS_S // 60), port=suffix)
    try:
        while (offer := pairing.read_offer(place, time.time())) is not None and offer.left > 0:
            time.sleep(POLL_S)
        time.sleep(POLL_S if offer is None else pairing.CONFIRM_S)  # the last exchange may still end well
    finally:
        pairing.offer_path(place).unlink(missing_ok=True)
    new = [peer for peer in peers_of(place) if peer not in before]
    if not new:
        raise AppError(LinkFault.CODE_USED_UP)
    print_text("cli.link.paired", name=sanitize_terminal(new[-1].name))


@cli.command("list")
def list_peers(home: HomeOption = None) -> None:
    """List the computers that this one is paired with."""
    from app.link.keys import peers_of

    peers = peers_of(find_home(home))
    for peer in peers:
        where = peer.host or tr("cli.link.laptop")
        typer.echo(sanitize_terminal(f"{peer.name}  {where}  {peer.paired_at}  {peer.fingerprint}"))
    if not peers:
        print_text("cli.link.none")


@cli.command()
def forget(
    name: Annotated[str, typer.Argument(help="Its name, address or fingerprint, as listed by `rleex link list`.")],
    home: HomeOption = None,
) -> None:
    """Forget a paired computer: it is not admitted any more. An engineer signs in first."""
    from app.link.keys import forget_peer

    place = find_home(home)
    sign_in(home, Permission.CONFIGURE)
    gone = forget_peer(place, name)
    print_text("cli.link.forgotten", name=sanitize_terminal(gone.name))
