"""Serves calls of NI's gRPC Device Server, for any simulated NI card.

The messages are those of nidaqmx.proto of ni/grpc-device, as compiled in nidaqmx's own stubs.
Errors go out as NI's server sends them: status UNKNOWN with the code in the trailing metadata
``ni-error``. A call that no card serves is UNIMPLEMENTED.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

from rigd.model.machine.extras import require
from rigd_sim.wire.cards.ni_card import DaqFault

SERVICE: Final = "nidaqmx_grpc.NiDAQmx"
#: Takes a request, and returns the fields of its answer, or what gives them.
Call = Callable[[Any], Any]


class Refused(Exception):
    """A request that the server itself refuses."""


def looked_up(table: Mapping[int, Any], request: Any) -> Any:
    """Return the value of the attribute that ``request`` asks for."""
    if request.attribute_raw not in table:
        raise DaqFault(
            -200197, f"The simulated card does not serve attribute 0x{request.attribute_raw:X}."
        )
    return table[request.attribute_raw]


def session(request: Any, sessions: Mapping[str, object]) -> tuple[str, bool]:
    """Return the name of the session that ``request`` begins or joins, and whether it is new.

    Raises:
        Refused: it begins one that there is, or joins one that there is not.
    """
    name = request.session_name or f"_unnamedTask<{len(sessions)}>"
    exists, behaviour = name in sessions, request.initialization_behavior
    if behaviour == 1 and exists:  # INITIALIZE_NEW
        raise Refused(f"Cannot initialize '{name}' when a session already exists.")
    if behaviour == 2 and not exists:  # ATTACH_TO_EXISTING
        raise Refused(f"Cannot attach to '{name}' because it has not been initialized.")
    return name, not exists


class GrpcServer:
    """A gRPC server of such calls at one address.

    Args:
        name: of the part that serves, for messages.
        address: host:port; port 0 takes a free one.
    """

    def __init__(self, name: str, address: str) -> None:
        self._name = name
        self._address = address
        self._server: Any = None

    async def start(self, calls: Mapping[str, Call]) -> int:
        """Serve ``calls``, by their names in nidaqmx.proto; return the port.

        Raises:
            MissingExtra: ``rigd[ni]``, which has the stubs of NI's server, is not installed.
            OSError: the address is in use.
        """
        require("ni", "a simulated NI card")
        import grpc
        import grpc.aio

        server = grpc.aio.server(options=[("grpc.so_reuseport", 0)])
        server.add_generic_rpc_handlers((_handlers(calls),))
        try:
            port: int = server.add_insecure_port(self._address)
        except RuntimeError as error:  # what gRPC makes of EADDRINUSE
            raise OSError(f"{self._name}: cannot serve at {self._address}: {error}") from error
        await server.start()
        self._server = server
        return port

    async def stop(self) -> None:
        """Stop serving; stopping twice is silent."""
        server, self._server = self._server, None
        if server is not None:
            await server.stop(grace=0.1)


def _handlers(calls: Mapping[str, Call]) -> Any:
    import grpc
    from nidaqmx._stubs import nidaqmx_pb2 as messages

    def handler(name: str, call: Call) -> Any:
        answer = getattr(messages, f"{name}Response")

        async def serve(request: Any, context: Any) -> Any:
            try:
                given = call(request)
                fields = await given if isinstance(given, Awaitable) else given
            except DaqFault as fault:
                code = ("ni-error", str(fault.code))
                await context.abort(grpc.StatusCode.UNKNOWN, str(fault), (code,))
            except Refused as refusal:
                await context.abort(grpc.StatusCode.FAILED_PRECONDITION, str(refusal))
            return answer(**fields)

        return grpc.unary_unary_rpc_method_handler(
            serve,
            request_deserializer=getattr(messages, f"{name}Request").FromString,
            response_serializer=answer.SerializeToString,
        )

    served = {name: handler(name, call) for name, call in calls.items()}
    return grpc.method_handlers_generic_handler(SERVICE, served)
