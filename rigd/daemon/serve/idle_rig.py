"""Reads channels and performs device actions while no run plays; the rig is not armed."""

from __future__ import annotations

from collections.abc import Callable

from rigd.config.rig import RigConfig
from rigd.daemon.live import Feed, Monitor
from rigd.daemon.manual import check_action, only, open_unarmed
from rigd.engine.play.control import Control
from rigd.engine.shared import RunFolder
from rigd.model.errors import ConfigError
from rigd.remote.protocol import Code, Refusal


class IdleRig:
    """Opens ``rig``, whose ``folder`` this process holds, while no run plays; once at a time.

    ``monitored``: :meth:`show` sends the channels to ``feed``; else it does nothing. If they cannot
    be shown, ``notify`` gets the reason.
    """

    def __init__(
        self,
        rig: RigConfig,
        folder: RunFolder,
        feed: Feed,
        *,
        monitored: bool,
        notify: Callable[[str], None],
    ) -> None:
        self._rig, self._folder, self._feed = rig, folder, feed
        self._monitored, self._notify = monitored, notify
        self._monitor: Monitor | None = None

    def show(self) -> None:
        """Show the channels until :meth:`end`."""
        if self._monitored and self._monitor is None:
            self._monitor = Monitor(self._rig, self._feed, self._folder, notify=self._notify)
            self._monitor.start()

    def end(self) -> None:
        """Return once every device is closed; silent if none is open."""
        monitor, self._monitor = self._monitor, None
        if monitor is not None:
            monitor.stop()

    def check(self, device: str, action: str) -> None:
        """Check that a device has an action.

        Raises:
            Refusal: it has not, or there is no such device.
        """
        try:
            check_action(self._rig, device, action)
        except ConfigError as error:
            raise Refusal(Code.NOT_FOUND, error.message, hint=error.hint) from error

    def act(self, device: str, action: str, control: Control) -> str:
        """Open a device, perform an action, and return the reply; a request of ``control`` ends it.

        Raises:
            Refusal: it was ended, or the device cannot be opened.
            RigdError: the device has failed, or refuses.
        """
        part, command = only(self._rig, {device}), f"rigd serve, {action} of {device}"
        with open_unarmed(part, control, command=command, held=self._folder) as look:
            reasons = look.open()
            if reasons:
                raise Refusal(Code.REFUSED, f"{device} cannot be opened: {'; '.join(reasons)}")
            look.first_rows()
            reply = look.act(device, action)
        if reply is None:
            raise Refusal(Code.REFUSED, f"{action} of {device} was ended: {control.reason}")
        return reply
