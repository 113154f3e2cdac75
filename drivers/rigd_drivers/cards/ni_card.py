"""Connects a driver to one NI card through NI-DAQmx, on this machine or behind NI's gRPC server.

The drivers of analogue inputs, of digital lines and of whole cards share this module. It finds
the card, names the tasks, and turns NI's errors into rigd's own errors. The module imports
``nidaqmx`` (the extra ``rigd[ni]``) only when a driver opens a card. ``nidaqmx`` ships no types,
so tasks are ``Any``.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, Final

from pydantic import Field

from rigd.model.errors import RigdError
from rigd.model.machine.extras import is_installed, missing
from rigd.sdk import DeviceError, DriverConfig, LinkError, ProtocolError

#: How long a device server may take to accept a connection,
CONNECT_S: Final = 5.0
#: and to answer a call: one that hangs must not hold us for ever, and nidaqmx sets no limit.
CALL_S: Final = 5.0

# Status codes, as named in nidaqmx.error_codes.DAQmxErrors.
_INVALID_DEVICE_ID: Final = -200220
#: RESOURCE_RESERVED (PAL), and DIG_LINES_RESERVED_OR_UNAVAILABLE.
_RESERVED: Final = frozenset({-50103, -200587})
#: What a card that is pulled out shows as: DEV_CANNOT_BE_ACCESSED, DRIVER_DEVICE_GUID_NOT_FOUND,
#: RUNTIME_ABORTED and RUNTIME_ABORTING, PAL_TRANSFER_ABORTED.
_REMOVED: Final = frozenset({-201003, -88705, -88709, -88710, -50405})


class NiCardConfig(DriverConfig):
    """Which card is used, and how it is connected."""

    device: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] = "Dev1"
    """Name of the card in NI MAX."""
    server: Annotated[str, Field(pattern=r"^\S+:\d+$")] | None = None
    """host:port of the NI gRPC Device Server that the card hangs on; without it, this machine's
    NI-DAQmx. The connection is neither encrypted nor authenticated: use it on a network of your
    own."""
    product: str | None = None
    """Product type that the card must have, such as USB-6009; checked when it is opened."""
    serial: Annotated[str, Field(pattern=r"^[0-9A-Fa-f]{1,8}$")] | None = None
    """Serial number that the card must have, in hexadecimal as printed on it."""


class NiCard:
    """One card through NI-DAQmx; errors of NI are raised as rigd's own errors.

    Args:
        config: which card.
        refused: what a rig file can ask for and a card refuse: status code -> what to change.
        call_s: returns the longest answer of a device server, in s, before each call.
    """

    def __init__(
        self,
        config: NiCardConfig,
        refused: Mapping[int, str],
        *,
        call_s: Callable[[], float] = lambda: CALL_S,
    ) -> None:
        self._config = config
        self._refused = refused
        self._call_s = call_s
        self._nidaqmx: Any = None
        self._server: Any = None  # the gRPC channel,
        self._calls: Any = None  # and the same with a deadline for every call

    def __str__(self) -> str:
        place = self._config.server or "this machine"
        return f"NI card {self._config.device} on {place}"

    @property
    def errors(self) -> Any:
        """``nidaqmx.errors``, once the card is open."""
        return self._nidaqmx.errors

    def open(self) -> str:
        """Find the card, and return how it identifies itself.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there.
            ProtocolError: it is another card than the rig file names.
        """
        self.connect()
        with self.doing("open"):
            return self._identify()

    def connect(self) -> None:
        """Reach NI-DAQmx, with any card.

        Raises:
            LinkError: NI-DAQmx or its server is not there.
        """
        self._nidaqmx = _import_nidaqmx()
        try:
            with self.doing("open"):
                self._connect()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the connection; its tasks are closed before. Closing twice is silent."""
        server, self._server, self._calls = self._server, None, None
        if server is not None:
            server.close()

    def name(self, *of: str) -> str:
        """Return the name of our task for ``of``: no other machine has one of that name."""
        parts = (item.replace("/", "_") for item in of)
        return "_".join(["rigd", socket.gethostname(), self._config.device, *parts])

    def new_task(self, name: str) -> Any:
        """Return a new task, to be used within :meth:`doing`."""
        return self._nidaqmx.Task(name, grpc_options=self._options(name))

    def new_watchdog(self, name: str, time_s: float) -> Any:
        """Return a task of the card's own watchdog timer; see :meth:`new_task`."""
        from nidaqmx.system.watchdog import WatchdogTask

        class Watchdog(WatchdogTask):  # type: ignore[misc]  # nidaqmx has no types
            def __del__(self) -> None:
                """Do not warn of a task that could not be closed: that was raised then."""

        return Watchdog(self._config.device, name, timeout=time_s, grpc_options=self._options(name))

    def device(self) -> Any:
        """Return the ``nidaqmx.system.Device``, to be used within :meth:`doing`."""
        from nidaqmx.system import Device

        return Device(self._config.device, grpc_options=self._options(""))

    def left_over(self, name: str) -> Any | None:
        """Return the task ``name`` that a server keeps, of a client that may have been killed.

        None if there is none; NI-DAQmx on this machine clears the tasks of a process itself.
        """
        if self._server is None:
            return None
        try:
            return self._nidaqmx.Task(name, grpc_options=self._options(name, attach=True))
        except self.errors.RpcError as error:
            if error.rpc_code.name != "FAILED_PRECONDITION":  # there is no such session
                raise
            return None

    @contextmanager
    def doing(self, doing: str) -> Iterator[None]:
        """Raise what NI raises as an error of rigd's own, which names what could not be done."""
        try:
            yield
        except self.errors.Error as error:
            raise self._translated(error, doing) from error

    def _connect(self) -> None:
        address = self._config.server
        if address is None:
            return
        import grpc

        self._server = grpc.insecure_channel(address)
        try:
            grpc.channel_ready_future(self._server).result(timeout=CONNECT_S)
        except grpc.FutureTimeoutError as error:
            raise LinkError(
                f"no NI gRPC Device Server answers at {address} within {CONNECT_S:g} s",
                hint="start ni_grpc_device_server there, or correct `server`",
            ) from error
        self._calls = _with_deadline(self._server, self._call_s)

    def _options(self, session: str, *, attach: bool = False) -> Any:
        """Return how to reach the server's session; None if NI-DAQmx is on this machine."""
        if self._server is None:
            return None
        from nidaqmx.grpc_session_options import GrpcSessionOptions, SessionInitializationBehavior

        behaviour = (
            SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION
            if attach
            else SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
        )
        return GrpcSessionOptions(self._calls, session, initialization_behavior=behaviour)

    def _identify(self) -> str:
        from nidaqmx.system import Device, System

        config, options = self._config, self._options("")
        system = System.local() if options is None else System.remote(options)
        names = list(system.devices.device_names)
        if config.device not in names:
            raise LinkError(
                f"there is no {self}: NI-DAQmx has {', '.join(names) or 'no device'}",
                hint="plug it in, or correct `device`",
            )
        device = Device(config.device, grpc_options=options)
        product, serial = str(device.product_type), int(device.serial_num)
        if config.product is not None and config.product != product:
            raise ProtocolError(
                f"{self} is a {product}, expected a {config.product}",
                hint="plug in the right card, or correct `product`",
            )
        if config.serial is not None and int(config.serial, 16) != serial:
            raise ProtocolError(
                f"{self} has the serial number {serial:08X}, expected {config.serial}",
                hint="plug in the right card, or correct `serial`",
            )
        version = ".".join(map(str, system.driver_version))
        return f"{product}, serial number {serial:08X}, NI-DAQmx {version}"

    def _translated(self, error: Exception, doing: str) -> RigdError:
        errors = self.errors
        if isinstance(error, errors.DaqNotFoundError | errors.DaqNotSupportedError):
            return LinkError(
                "NI-DAQmx is not installed on this machine",
                hint="install it (`python -m nidaqmx installdriver`), or give `server: HOST:PORT` "
                "of a machine that has it",
            )
        if isinstance(error, errors.RpcError):
            return LinkError(
                f"cannot {doing} {self}: the device server fails with {error}",
                hint="see that ni_grpc_device_server runs there and can be reached",
            )
        code: int = getattr(error, "error_code", 0)
        text = f"NI-DAQmx {code}: {str(error).splitlines()[0]}"
        if code in _REMOVED:
            return DeviceError(
                f"{self} is gone ({text})", hint="plug it in again; look at cable and hub"
            )
        if code == _INVALID_DEVICE_ID or code in _RESERVED:
            return LinkError(
                f"cannot {doing} {self} ({text})",
                hint="correct `device`"
                if code == _INVALID_DEVICE_ID
                else "end the other program that uses the card",
            )
        return DeviceError(f"cannot {doing} {self} ({text})", hint=self._refused.get(code))


def _import_nidaqmx() -> Any:
    if not is_installed("ni"):
        raise LinkError(missing("an NI card", "ni"))
    import nidaqmx

    return nidaqmx


def _with_deadline(channel: Any, call_s: Callable[[], float]) -> Any:
    import grpc

    class Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]  # grpc has no types
        def intercept_unary_unary(self, proceed: Any, details: Any, request: Any) -> Any:
            return proceed(details._replace(timeout=call_s()), request)

    return grpc.intercept_channel(channel, Deadline())
