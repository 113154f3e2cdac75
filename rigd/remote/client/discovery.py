"""Finds rigs: those in the client's list, and those that have a daemon on this machine."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from rigd.config.remote import DEFAULT_ENDPOINT
from rigd.model.errors import RigdError
from rigd.remote.client.connection import Connection
from rigd.remote.client.queries import rigs_alive
from rigd.remote.client.rigs.address import Remote
from rigd.remote.client.rigs.remotes import read_remotes
from rigd.remote.client.rigs.target import Target, make_target
from rigd.remote.client.session import close_session, open_session
from rigd.remote.protocol import Status


@dataclass(frozen=True)
class DiscoveredRig:
    """A rig with the status that its daemon sent, or with the ``problem`` if there is no status."""

    rig: str
    endpoint: str
    status: Status | None = None
    problem: str = ""


async def discover_rigs(served: Mapping[str, str] = MappingProxyType({})) -> list[DiscoveredRig]:
    """Return all rigs of the list, and those on this machine that are not in it, by name.

    ``served`` has the addresses of rigs that are known to be served on this machine.

    Raises:
        ConfigError: the list is wrong.
    """
    known = dict(read_remotes())
    known |= {rig: Remote(endpoint) for rig, endpoint in served.items() if rig not in known}
    async with asyncio.TaskGroup() as group:
        listed = [group.create_task(_look(name, item)) for name, item in known.items()]
        here = group.create_task(_discover_local(frozenset(known)))
    found = [task.result() for task in listed] + here.result()
    return sorted(found, key=lambda item: item.rig)


async def _look(rig: str, remote: Remote) -> DiscoveredRig:
    try:
        return await _status_of(make_target(rig, remote.endpoint, remote.tls, remote.identity))
    except RigdError as error:
        return DiscoveredRig(rig, remote.endpoint, problem=error.message)


async def _discover_local(known: frozenset[str]) -> list[DiscoveredRig]:
    """Return the rigs on this machine, but those that are ``known``."""
    target = make_target()
    try:
        session = await asyncio.to_thread(open_session, target)
    except RigdError:
        return []  # no daemon on this machine, which is no error
    try:
        alive = await rigs_alive(session)
    finally:
        await asyncio.to_thread(close_session, session)
    return [await _look(rig, Remote(DEFAULT_ENDPOINT)) for rig in alive if rig not in known]


async def _status_of(target: Target) -> DiscoveredRig:
    async with await Connection.open(target) as connection:
        return DiscoveredRig(connection.rig, target.endpoint, await connection.status())
