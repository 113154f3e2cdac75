"""NI-DAQmx as the driver needs it: one task of analogue inputs, here or behind a gRPC server.

``nidaqmx`` (the extra ``rigd[ni]``) is imported when a card is opened and not before. It ships no
types; everything of it stays in this module.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.errors import RigdError
from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.ni_daq.config import NiDaqConfig, Terminal

#: How long a device server may take to accept a connection,
CONNECT_S: Final = 5.0
#: and to answer a call: one that hangs must not hold us for ever, and nidaqmx sets no limit.
CALL_S: Final = 5.0
#: A task that nobody reads from for so long, in s, and so many blocks, has lost its client.
ABANDONED_S: Final = 0.5
_MISSED_BLOCKS: Final = 5
_LOOK_S: Final = 0.02

_TERMINALS: Final = {
    Terminal.DEFAULT: "DEFAULT",
    Terminal.RSE: "RSE",
    Terminal.NRSE: "NRSE",
    Terminal.DIFFERENTIAL: "DIFF",
    Terminal.PSEUDO_DIFFERENTIAL: "PSEUDO_DIFF",
}

# Status codes, as named in nidaqmx.error_codes.DAQmxErrors.
_SAMPLES_NOT_YET_AVAILABLE: Final = -200284
_SAMPLES_NO_LONGER_AVAILABLE: Final = -200279
_INVALID_DEVICE_ID: Final = -200220
_RESOURCE_RESERVED: Final = -50103
#: What a card that is pulled out shows as: DEV_CANNOT_BE_ACCESSED, DRIVER_DEVICE_GUID_NOT_FOUND,
#: RUNTIME_ABORTED and RUNTIME_ABORTING, PAL_TRANSFER_ABORTED.
_REMOVED: Final = frozenset({-201003, -88705, -88709, -88710, -50405})
#: What a rig file can ask for and a card refuse: option -> codes (INVALID_ATTRIBUTE_VALUE,
#: SAMPLE_RATE_NUM_CHANS_CONVERT_PERIOD_COMBO, PHYSICAL_CHAN_DOES_NOT_EXIST).
_REFUSED: Final = {
    -200077: "change `terminal` or `range` of the input, or `rate`, to what the card can do",
    -200081: "lower `rate` or remove inputs: the card has one converter for all of them",
    -200170: "correct `channel` of the input; NI MAX shows which the card has",
}


class Daqmx:
    """One card through NI-DAQmx; what NI raises comes out as an error of rigd's own."""

    def __init__(self, config: NiDaqConfig) -> None:
        self._config = config
        self._nidaqmx: Any = None
        self._server: Any = None  # the gRPC channel,
        self._calls: Any = None  # and the same with a deadline for every call
        self._task: Any = None
        self._reader: Any = None

    @property
    def _where(self) -> str:
        place = self._config.server or "this machine"
        return f"NI card {self._config.device} on {place}"

    def open(self) -> str:
        """Find the card, make the task, and return what the card says it is.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there, or somebody else has it.
            ProtocolError: it is another card than the rig file names.
            DeviceError: the card cannot do what the rig file asks.
        """
        self._nidaqmx = _import_nidaqmx()
        with self._doing("open"):
            self._connect()
            identity = self._identify()
            self._make_task()
        return identity

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
        self._calls = _with_deadline(self._server)

    def _options(self, session: str, *, attach: bool = False) -> Any:
        """Return how to reach the server's session; None where NI-DAQmx is on this machine."""
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
                f"there is no {self._where}: NI-DAQmx has {', '.join(names) or 'no device'}",
                hint="plug it in, or correct `device`",
            )
        device = Device(config.device, grpc_options=options)
        product, serial = str(device.product_type), int(device.serial_num)
        if config.product is not None and config.product != product:
            raise ProtocolError(
                f"{self._where} is a {product}, expected a {config.product}",
                hint="plug in the right card, or correct `product`",
            )
        if config.serial is not None and int(config.serial, 16) != serial:
            raise ProtocolError(
                f"{self._where} has the serial number {serial:08X}, expected {config.serial}",
                hint="plug in the right card, or correct `serial`",
            )
        version = ".".join(map(str, system.driver_version))
        return f"{product}, serial number {serial:08X}, NI-DAQmx {version}"

    def _make_task(self) -> None:
        from nidaqmx.constants import AcquisitionType, TerminalConfiguration
        from nidaqmx.stream_readers import AnalogMultiChannelReader

        config = self._config
        # A server keeps the task of a client that was killed. Ours is known by its name.
        name = f"rigd_{socket.gethostname()}_{config.device}"
        if self._server is not None:
            self._clear_left_over(name)
        task = self._task = self._nidaqmx.Task(name, grpc_options=self._options(name))
        for one in config.inputs:
            task.ai_channels.add_ai_voltage_chan(
                f"{config.device}/{one.channel}",
                terminal_config=TerminalConfiguration[_TERMINALS[one.terminal]],
                min_val=-one.range,
                max_val=one.range,
            )
        task.timing.cfg_samp_clk_timing(
            config.rate,
            sample_mode=AcquisitionType.CONTINUOUS,
            samps_per_chan=config.buffer_samples,
        )
        self._reader = AnalogMultiChannelReader(task.in_stream)
        self._reader.verify_array_shape = False  # it would ask the server before every read

    def _clear_left_over(self, name: str) -> None:
        from nidaqmx.errors import RpcError

        try:
            left_over = self._nidaqmx.Task(name, grpc_options=self._options(name, attach=True))
        except RpcError as error:
            if error.rpc_code.name != "FAILED_PRECONDITION":  # there is no such session
                raise
        else:
            if self._is_read(left_over):
                raise LinkError(
                    f"{self._where} is in use: another rigd on this machine reads from it",
                    hint="end that run first",
                )
            left_over.close()

    def _is_read(self, task: Any) -> bool:
        """Return whether somebody fetches samples of ``task``: its client then lives."""
        blocks_s = _MISSED_BLOCKS * self._config.block / self._config.rate
        deadline = time.monotonic() + max(ABANDONED_S, blocks_s)
        try:
            began = task.in_stream.curr_read_pos
            while time.monotonic() < deadline:
                time.sleep(_LOOK_S)
                if task.in_stream.curr_read_pos != began:
                    return True
        except self._nidaqmx.errors.DaqError:
            return False  # it does not run, or has stopped by itself as its buffer was full
        return False

    def rate_hz(self) -> float:
        """Return the rate that the card makes of the one asked for: a divisor of its crystal's."""
        with self._doing("ask for the rate of"):
            return float(self._task.timing.samp_clk_rate)

    def ranges_v(self) -> NDArray[np.float64]:
        """Return lowest and highest voltage of each input's range, shape (inputs, 2)."""
        with self._doing("ask for the ranges of"):
            return np.array(
                [(one.ai_rng_low, one.ai_rng_high) for one in self._task.ai_channels], np.float64
            )

    def start(self) -> None:
        """Begin to sample."""
        with self._doing("start"):
            self._task.start()

    def read(self, volts: NDArray[np.float64], timeout_s: float) -> NDArray[np.float64]:
        """Wait for samples and return them as a view into ``volts``, shape (inputs, n).

        n is below the width of ``volts`` (inputs, block) only where the time was up before.
        """
        inputs, block = volts.shape
        with self._doing("read"):
            try:
                self._reader.read_many_sample(volts, block, timeout_s)
            except self._nidaqmx.errors.DaqReadError as error:
                if error.error_code != _SAMPLES_NOT_YET_AVAILABLE:
                    raise
                # NI-DAQmx hands over what it has, packed at the beginning of the array and not in
                # rows as wide as asked for (nidaqmx-python issue 528).
                count = int(error.samps_per_chan_read)
                return volts.ravel()[: inputs * count].reshape(inputs, count)
        return volts

    def close(self) -> None:
        """Stop and forget the task; closing twice is silent, and so is closing what is lost.

        :meth:`read` has told of the loss. A task that a server keeps is cleared by the next
        :meth:`open`.
        """
        task, self._task, self._reader = self._task, None, None
        server, self._server, self._calls = self._server, None, None
        try:
            if task is not None:
                with suppress(self._nidaqmx.errors.Error):
                    task.close()
        finally:
            if server is not None:
                server.close()

    @contextmanager
    def _doing(self, doing: str) -> Iterator[None]:
        """Raise what NI raises as an error of rigd's own, which says what could not be done."""
        try:
            yield
        except self._nidaqmx.errors.Error as error:
            raise self._translated(error, doing) from error

    def _translated(self, error: Exception, doing: str) -> RigdError:
        errors = self._nidaqmx.errors
        if isinstance(error, errors.DaqNotFoundError | errors.DaqNotSupportedError):
            return LinkError(
                "NI-DAQmx is not installed on this machine",
                hint="install it (`python -m nidaqmx installdriver`), or give `server: HOST:PORT` "
                "of a machine that has it",
            )
        if isinstance(error, errors.RpcError):
            return LinkError(
                f"cannot {doing} {self._where}: the device server fails with {error}",
                hint="see that ni_grpc_device_server runs there and can be reached",
            )
        code: int = getattr(error, "error_code", 0)
        config, told = self._config, f"NI-DAQmx {code}: {str(error).splitlines()[0]}"
        if code == _SAMPLES_NO_LONGER_AVAILABLE:
            return DeviceError(
                f"{self._where} overran: samples were lost because they were not fetched within "
                f"{config.buffer:g} s ({told})",
                hint="make `buffer` or `block` larger, or `rate` smaller; a network that stalls "
                "this long is not fit for it",
            )
        if code in _REMOVED:
            return DeviceError(
                f"{self._where} is gone ({told})", hint="plug it in again; look at cable and hub"
            )
        if code in (_INVALID_DEVICE_ID, _RESOURCE_RESERVED):
            return LinkError(
                f"cannot {doing} {self._where} ({told})",
                hint="correct `device`"
                if code == _INVALID_DEVICE_ID
                else "end the other program that uses the card",
            )
        return DeviceError(f"cannot {doing} {self._where} ({told})", hint=_REFUSED.get(code))


def _import_nidaqmx() -> Any:
    try:
        import nidaqmx
    except ImportError as error:
        raise LinkError(
            f"the Python package nidaqmx cannot be imported: {error}",
            hint="install it: pip install 'rigd[ni]'",
        ) from error
    return nidaqmx


def _with_deadline(channel: Any) -> Any:
    import grpc

    class Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]  # grpc has no types
        def intercept_unary_unary(self, proceed: Any, details: Any, request: Any) -> Any:
            return proceed(details._replace(timeout=CALL_S), request)

    return grpc.intercept_channel(channel, Deadline())
