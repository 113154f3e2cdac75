"""Shows a remote run at a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.progress import TextColumn

from rigd.cli.trial_bar import TrialBar
from rigd.remote.protocol import Status
from rigd.remote.protocol.results import RunLine
from rigd.remote.protocol.status import LastRun, TrialStatus


class RemoteDisplay(TrialBar):
    """Progress on standard error: a bar on a terminal, a line per trial elsewhere."""

    def __init__(self, *, quiet: bool) -> None:
        super().__init__(TextColumn("{task.fields[left]}"), quiet=quiet)
        self._task = self._bar.add_task("preflight", total=1, left="")
        self._trial: TrialStatus | None = None
        self._state = ""

    def announce(self, line: str) -> None:
        """Say what is watched."""
        if not self._quiet:
            self._console.print(escape(line))

    def show(self, status: Status) -> None:
        """Show where the run stands."""
        if self._quiet:
            return
        trial = status.trial
        if trial is not None and trial != self._trial and not self._console.is_terminal:
            which = f"trial {status.trials_done + 1}/{status.trials_total}"
            self._console.print(escape(f"{which}: {trial.label}" if trial.label else which))
        if status.state != self._state and status.state in ("pausing", "paused", "stopping"):
            self.tell(f"{status.state}; rigd remote resume goes on"
                      if status.state == "paused" else status.state)  # fmt: skip
        self._trial, self._state = trial, status.state
        what: str = status.state
        if trial is not None:
            what = trial.label or f"trial {trial.number}"
            what += f" · {status.step}" if status.step else ""
        left = "" if status.left_s is None else f"{status.left_s:.0f} s left"
        self._bar.update(
            self._task,
            total=max(status.trials_total, 1),
            completed=status.trials_done,
            description=escape(what),
            left=left,
        )

    def show_silence(self, silent_s: float) -> None:
        """Show that what stands on the screen is old."""
        self._bar.update(self._task, description=f"[red]nothing heard for {silent_s:.0f} s[/]")


def conclude(last: LastRun, line: RunLine | None, where: str) -> None:
    """Say how the run ended and what to do next; ``where`` are the options that find the rig.

    ``line`` is None where nothing was recorded, or the daemon is gone with its run.
    """
    colour = "red" if last.exit_code else "green"
    console = Console(highlight=False, soft_wrap=True)
    console.print(f"[{colour}]{last.ending}[/]: {escape(last.reason)}; ", end="")
    if line is None:
        console.print("the daemon has ended too" if last.recorded else "nothing was recorded")
        return
    console.print(
        f"{line.trials_done} of {line.trials_total} trials, {line.duration_s:.1f} s of rig time"
    )
    if line.trials_done < line.trials_total:
        console.print(escape(f"go on with:  rigd remote resume-run {last.run}{where}"))
    console.print(escape(f"fetch it:    rigd remote fetch {last.run}{where}"))
