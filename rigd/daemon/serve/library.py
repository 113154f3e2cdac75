"""Lists the procedures of a daemon and checks whether they can run on its rig."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.analysis.plan import judged
from rigd.config.rig import RigConfig
from rigd.model.errors import ConfigError
from rigd.procedure.loader import Procedure, load_procedure, parse_procedure
from rigd.procedure.program import CompiledProcedure, Prompt
from rigd.procedure.sweep import MAX_SIZE, TooLong
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.arguments import Checked, ProcedureFile
from rigd.remote.protocol.results import (
    CheckReport,
    ParameterView,
    ProblemView,
    ProcedureLine,
    Procedures,
    ProcedureView,
)
from rigd.sdk.shipped_files import shipped_folder

#: A procedure of no more steps and values, all trials together, is checked in the daemon: within
#: 0.1 s.
SHORT: Final = 4_000
#: The form of the name of a procedure.
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,59}")


@dataclass(frozen=True)
class _Wrong:
    """A procedure file that contains an error."""

    path: Path
    error: ConfigError

    @property
    def name(self) -> str:
        return self.path.stem

    @property
    def problem(self) -> str:
        """The first problem with its place; the path of the folder is not shown to clients."""
        place = self.error.place
        where = "" if place is None else f":{place.line}:{place.column}"
        return f"{self.path.name}{where}: {self.error.message}"


class Library:
    """The procedures of ``folder``, and the shipped procedures that no file there replaces."""

    def __init__(self, rig: RigConfig, folder: Path) -> None:
        self._rig = rig
        self._folders = (folder, shipped_folder("procedures"))

    def lines(self) -> Procedures:
        """Return those that can run on this rig, then the others with the reason; each by name."""
        lines = [self._line(item) for item in self._all()]
        return Procedures(
            procedures=tuple(sorted(lines, key=lambda line: line.problem is not None))
        )

    def view(self, name: str) -> ProcedureView:
        """Return a procedure and the data for its form.

        Raises:
            Refusal: there is none of that name, or it is wrong.
        """
        known = {item.name: item for item in self._all()}
        found = known.get(name)
        if found is None:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(known)}"
            raise Refusal(Code.NOT_FOUND, f"the daemon has no procedure {name!r}", hint=hint)
        if isinstance(found, _Wrong):
            raise Refusal(Code.REFUSED, found.problem, hint=found.error.hint)
        return _view(found)

    def check(self, args: Checked) -> CheckReport | None:
        """Return whether a procedure can run on this rig with these values.

        None if it has too many steps and values for this process: other requests would wait.
        """
        try:
            return check(args, self._rig, SHORT)
        except TooLong:
            return None

    def compile(self, args: Checked) -> CompiledProcedure:
        """Return a procedure that a client sent, ready to play on this rig.

        Raises:
            ConfigError: it does not fit; names every problem with its place.
        """
        return _compile(args, self._rig, MAX_SIZE)

    def _line(self, procedure: Procedure | _Wrong) -> ProcedureLine:
        if isinstance(procedure, _Wrong):
            return ProcedureLine(name=procedure.name, problem=procedure.problem)
        problem = None
        if not _undecided(procedure):
            try:
                judged(procedure, self._rig)
            except ConfigError as error:
                problem = error.message
        return ProcedureLine(
            name=procedure.name,
            title=procedure.source.title,
            sha256=_file_of(procedure).sha256,
            problem=problem,
        )

    def _all(self) -> Sequence[Procedure | _Wrong]:
        found: dict[str, Procedure | _Wrong] = {}
        for file in self._files():
            found.setdefault(file.name, file)
        return [found[name] for name in sorted(found)]

    def _files(self) -> Iterator[Procedure | _Wrong]:
        for folder in self._folders:
            for path in sorted(item for item in folder.glob("*.yaml") if item.is_file()):
                try:
                    yield load_procedure(path)
                except ConfigError as error:
                    # By its file's name, so that no shipped procedure is run in its place.
                    if _NAME.fullmatch(path.stem):
                        yield _Wrong(path, error)


def check(args: Checked, rig: RigConfig, most: int = MAX_SIZE) -> CheckReport:
    """Return whether a procedure can run on ``rig`` with these values.

    Raises:
        TooLong: it has more steps and values than ``most``, and fewer than any may have.
    """
    try:
        compiled = _compile(args, rig, most)
    except ConfigError as error:
        if isinstance(error, TooLong) and error.size <= MAX_SIZE:
            raise
        problems = tuple(_problem(item) for item in (error, *error.others))
        return CheckReport(ok=False, problems=problems)
    asked = [step for step in compiled.steps() if isinstance(step, Prompt)]
    return CheckReport(ok=True, trials=len(compiled.trials), prompts=len(asked))


def _compile(args: Checked, rig: RigConfig, most: int) -> CompiledProcedure:
    # Errors name it before line and column; a client has no use for a path of this machine.
    source = parse_procedure(args.procedure.text, Path(f"{args.procedure.name}.yaml"))
    return judged(source, rig, args.set, most=most)


def _view(procedure: Procedure) -> ProcedureView:
    source = procedure.source
    swept = {*source.sweep.grid, *source.sweep.zip}
    parameters = tuple(
        ParameterView(
            name=name,
            doc=parameter.doc,
            unit=parameter.unit or "1",
            choices=tuple(parameter.choices or ()),
            default=parameter.default,
            min=parameter.min,
            max=parameter.max,
            swept=name in swept,
        )
        for name, parameter in source.parameters.items()
    )
    return ProcedureView(
        procedure=_file_of(procedure),
        title=source.title,
        doc=source.doc,
        parameters=parameters,
        on_client_loss=source.on_client_loss,
    )


def _undecided(procedure: Procedure) -> Mapping[str, object]:
    """Return the parameters without a value; the procedure can be checked only with them."""
    source = procedure.source
    swept = {*source.sweep.grid, *source.sweep.zip}
    return {
        name: parameter
        for name, parameter in source.parameters.items()
        if parameter.default is None and name not in swept
    }


def _problem(error: ConfigError) -> ProblemView:
    place = error.place
    return ProblemView(
        message=error.message,
        hint=error.hint,
        line=None if place is None else place.line,
        column=None if place is None else place.column,
    )


def _file_of(procedure: Procedure) -> ProcedureFile:
    return ProcedureFile.of(procedure.name, procedure.file.text)
