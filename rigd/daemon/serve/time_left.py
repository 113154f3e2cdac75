"""Estimates the time that a run still needs from the duration of its trials."""

from __future__ import annotations

from rigd.engine.result import Progress


class TimeLeft:
    """Follows one run; ``expected_s`` is what a dry run of it took, where there was one."""

    def __init__(self, expected_s: float | None = None) -> None:
        self._expected_s = expected_s
        self._took_s: list[float] = []
        self._trial: int | None = None
        self._since_s = 0.0

    def watch(self, progress: Progress) -> None:
        """Take note of where the run stands; a pause belongs to no trial, a prompt does."""
        number = None if progress.trial is None else progress.trial.number
        if number == self._trial:
            return
        if self._trial is not None:
            self._took_s.append(progress.run_s - self._since_s)
        self._trial, self._since_s = number, progress.run_s

    def left_s(self, progress: Progress) -> float | None:
        """Return the seconds until the last trial ends, as far as that can be told."""
        if not self._took_s:
            expected = self._expected_s
            return None if expected is None else max(expected - progress.run_s, 0.0)
        mean_s = sum(self._took_s) / len(self._took_s)
        remaining = progress.trials_total - progress.trials_done
        begun_s = 0.0 if self._trial is None else progress.run_s - self._since_s
        return max(remaining * mean_s - min(begun_s, mean_s), 0.0)
