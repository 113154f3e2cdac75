"""``rigd remote start`` and ``resume-run``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.about import add_about, read_about
from rigd.cli.remote.command import RemoteCommand, add_json, again, connect_async, print_json
from rigd.cli.remote.procedures import add_procedure, values_of

if TYPE_CHECKING:
    from rigd.remote import AsyncClient
    from rigd.remote.protocol.results import Started


def _configure_start(parser: argparse.ArgumentParser) -> None:
    add_procedure(parser)
    parser.add_argument(
        "--yes", action="store_true", help="answer prompts with the procedure's own answers"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the simulation (default 1)")
    parser.add_argument(
        "--on-client-loss",
        choices=("continue", "finish_trial", "stop"),
        help="what the run does when this command vanishes while it watches (default: what the "
        "procedure says)",
    )
    add_about(parser)
    _configure_watch(parser)


def _configure_resume(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", metavar="RUN", help="an interrupted run, as the status shows it")
    _configure_watch(parser)


def _configure_watch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--watch", action="store_true", help="show progress to the end, and ask prompts here"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    add_json(parser)


def _start(args: argparse.Namespace) -> int:
    from rigd.config.shipped import is_path
    from rigd.procedure.loader import load_procedure

    about = read_about(None, args.note, args.meta)

    async def begin(rig: AsyncClient) -> Started:
        if not is_path(args.procedure):
            await _tell_apart(rig, args.procedure)
        return await rig.start(
            args.procedure,
            values_of(args),
            seed=args.seed,
            answers="procedure" if args.yes else "ask",
            on_client_loss=args.on_client_loss,
            note=about.note,
            meta=about.meta,
        )

    if is_path(args.procedure):
        load_procedure(args.procedure)  # what is wrong in it is told before anybody is asked
    return _begin(args, begin)


async def _tell_apart(rig: AsyncClient, name: str) -> None:
    """Say so where a file of that name is here too, and is not what the daemon has.

    Raises:
        Refusal: the daemon has none of that name.
    """
    from rigd.remote.protocol import Code, Refusal

    places = Path(f"{name}.yaml"), Path("procedures", f"{name}.yaml")
    own = next((path for path in places if path.is_file()), None)
    if own is None:
        return
    try:
        theirs = (await rig.procedure(name)).procedure
    except Refusal as error:
        if error.code is not Code.NOT_FOUND:
            raise
        hint = f"there is one here; to start that, give its path: {own}"
        raise Refusal(error.code, error.message, hint=hint) from error
    if own.read_bytes() != theirs.text.encode():
        note = f"starting {name} as the daemon has it; to start yours, give its path: {own}"
        print(note, file=sys.stderr)


def _resume(args: argparse.Namespace) -> int:
    async def begin(rig: AsyncClient) -> Started:
        return await rig.resume_run(args.run)

    return _begin(args, begin)


def _begin(args: argparse.Namespace, begin: Callable[[AsyncClient], Awaitable[Started]]) -> int:
    """Begin a run; watched, with the lease held all the while, else without anybody's."""
    import asyncio

    from rigd.cli.remote.watching import watch
    from rigd.model.errors import LinkError

    async def run() -> int:
        code: int | None = None
        async with connect_async(args) as rig:
            try:
                async with rig.control(brief=not args.watch):
                    name = _name(await begin(rig))
                    if args.watch:
                        code = await watch(rig, name, args, steers=True)
            except LinkError:
                if code is None:
                    raise  # else the daemon left with its run: nobody takes control back
        if code is not None:
            return code
        if args.json:
            print_json({"run": name})
        else:
            print(_what_next(name, again(args)))
        return 0

    return asyncio.run(run())


def _name(started: Started) -> str:
    from rigd.model.errors import ProtocolError

    if started.run is None:
        raise ProtocolError("the daemon began a run, and does not say which")
    return started.run


def _what_next(run: str, where: str) -> str:
    return f"""\
{run}
It goes on by itself and needs nobody; prompts wait for an answer.
  rigd remote status --watch{where}
  rigd remote answer VALUE{where}
  rigd remote stop{where}"""


COMMANDS = {
    "start": RemoteCommand(
        "start a procedure on a rig",
        _start,
        _configure_start,
        """\
examples:
  rigd remote start procedures/quick.yaml --rig lugre-1 --watch
  rigd remote start constant_current --set floor=pvc        one that the daemon has
  rigd remote start procedures/quick.yaml --yes --watch --json

With --watch this command has control to the end and exits as the run did; should it vanish, the
run does what the procedure says (`on_client_loss`). Ctrl-C then asks whether to stop the run or
only the watching. Without --watch the run needs nobody, and prompts wait for whoever answers.
""",
    ),
    "resume-run": RemoteCommand(
        "go on with an interrupted run: only the trials that are missing",
        _resume,
        _configure_resume,
    ),
}
