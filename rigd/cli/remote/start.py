"""``rigd remote start`` and ``resume-run``: start a run on a rig, or continue one."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_about, add_json, add_quiet, read_about
from rigd.cli.remote.command import RemoteCommand, again, connect_async, print_json
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
    add_about(parser)
    _configure_watch(parser)


def _configure_resume(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run", metavar="RUN", help=("an interrupted run, as `rigd remote status` shows it")
    )
    _configure_watch(parser)


def _configure_watch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--watch", action="store_true", help="show progress to the end, and ask prompts here"
    )
    parser.add_argument(
        "--on-client-loss",
        choices=("continue", "finish_trial", "stop"),
        help="what the run does if this command vanishes while it watches (default: as the "
        "procedure specifies)",
    )
    add_quiet(parser)
    add_json(parser)


def _start(args: argparse.Namespace) -> int:
    from rigd.config.shipped_files import is_path
    from rigd.procedure.loader import load_own_procedure

    about = read_about(None, args.note, args.meta, args.specimen)

    async def begin(rig: AsyncClient) -> Started:
        if not is_path(args.procedure):
            await _warn_if_different(rig, args.procedure)
        return await rig.start(
            args.procedure,
            values_of(args),
            seed=args.seed,
            answers="procedure" if args.yes else "ask",
            on_client_loss=args.on_client_loss,
            note=about.note,
            meta=about.meta,
            specimen=about.specimen,
        )

    if is_path(args.procedure):
        load_own_procedure(args.procedure)  # reports errors in the file before the daemon is asked
    return _begin(args, begin)


async def _warn_if_different(rig: AsyncClient, name: str) -> None:
    """Print a notice if a local file of that name differs from the daemon's.

    Raises:
        Refusal: the daemon has no procedure of that name.
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
        hint = f"there is a local file of that name; to start it, give its path: {own}"
        raise Refusal(error.code, error.message, hint=hint) from error
    if own.read_bytes() != theirs.text.encode():
        note = f"starting {name} as the daemon has it; to start your own file, give its path: {own}"
        print(note, file=sys.stderr)


def _resume(args: argparse.Namespace) -> int:
    async def begin(rig: AsyncClient) -> Started:
        return await rig.resume_run(args.run, on_client_loss=args.on_client_loss)

    return _begin(args, begin)


def _begin(args: argparse.Namespace, begin: Callable[[AsyncClient], Awaitable[Started]]) -> int:
    """Start a run; a watched run keeps the lease to its end, another run keeps no lease."""
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
                    raise  # else the daemon ended with its run: nothing to release
        if code is not None:
            return code
        if args.json:
            print_json({"run": name})
        else:
            print(_advice(name, vars(args).get("yes"), again(args)))
        return 0

    return asyncio.run(run())


def _name(started: Started) -> str:
    from rigd.model.errors import ProtocolError

    if started.run is None:
        raise ProtocolError("the daemon started a run, but its reply does not name it")
    return started.run


def _advice(run: str, by_procedure: bool | None, target_options: str) -> str:
    """Return what to do next; who answers a run that is resumed (None) its recording says."""
    answered = {
        False: "prompts wait for an answer.",
        True: "the procedure answers its prompts.",
        None: "prompts are answered as before the interruption, by the procedure or by a person.",
    }[by_procedure]
    answer = "" if by_procedure else f"\n  rigd remote answer VALUE{target_options}"
    return f"""\
{run}
The run needs no client; {answered}
  rigd remote status --watch{target_options}{answer}
  rigd remote stop{target_options}"""


COMMANDS = {
    "start": RemoteCommand(
        "start a procedure on a rig",
        _start,
        _configure_start,
        """\
examples:
  rigd remote start quick --rig lugre-1 --watch             a procedure that the daemon has
  rigd remote start procedures/mine.yaml --set floor=pvc    a file of yours
  rigd remote start quick --yes --watch --json

With --watch this command has control to the end and exits with the run's exit code; if it vanishes,
the run follows `on_client_loss` of the procedure. Ctrl-C asks whether to stop the run or only the
watching. Without --watch the run needs no client, and prompts wait for an answer.
""",
    ),
    "resume-run": RemoteCommand(
        "continue an interrupted run: only the missing trials",
        _resume,
        _configure_resume,
    ),
}
