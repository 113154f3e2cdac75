"""Makes all checks that can refuse a run before anything is armed (the preflight)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from rigd.engine.play.player import Outcome
from rigd.engine.run.answers import Answers
from rigd.engine.run.host import Host
from rigd.model.errors import Blocked
from rigd.model.severity import Severity
from rigd.procedure.program import CompiledProcedure, Prompt

#: Cycles read before arming, so that a failed sensor or an active trip is noticed at rest.
PREFLIGHT_CYCLES = 20

#: From the identities of the devices to the reasons why the rig cannot be armed.
IdentityCheck = Callable[[Mapping[str, str]], Sequence[str]]


def preflight(
    host: Host,
    procedure: CompiledProcedure,
    answers: Answers,
    extra_checks: Sequence[Callable[[], Sequence[str]]] = (),
    identity_check: IdentityCheck = lambda _: (),
) -> Outcome | None:
    """Open every device, check it at rest, and raise unless all checks pass.

    ``extra_checks`` run before anything is opened, ``identity_check`` on the open devices. Returns
    an outcome if a person stopped it meanwhile.

    Raises:
        Blocked: with every reason found, not only the first.
    """
    reasons = [reason for check in extra_checks for reason in check()]
    reasons += _unanswerable(procedure, answers)
    closed = host.open()
    reasons += closed
    if not closed:
        reasons += identity_check(host.identities())
        outcome = host.settle(PREFLIGHT_CYCLES)
        if outcome is not None and outcome.trip is None and outcome.severity is not Severity.FAULT:
            return outcome
        if outcome is not None and outcome.trip is None:
            reasons.append(outcome.reason)
        reasons += host.arming_blockers()  # trips at rest among them
    if reasons:
        raise Blocked(list(dict.fromkeys(reasons)))
    return None


def _unanswerable(procedure: CompiledProcedure, answers: Answers) -> Iterator[str]:
    asked = {step.name: step for step in procedure.steps() if isinstance(step, Prompt)}
    for prompt in asked.values():
        if not answers.can_answer(prompt):
            yield (
                f"prompt {prompt.name!r} needs an operator: run in a terminal, or give the prompt "
                f"an `answer` in the procedure and use --yes"
            )
