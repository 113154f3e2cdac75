"""Builds the JSON Schema of every message, for clients in other languages."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import models_json_schema

from rigd.remote.protocol.limits import VERSION
from rigd.remote.protocol.request import ErrorReply, Reply, request_kind
from rigd.remote.protocol.status import RigEvent, Status
from rigd.remote.protocol.verbs import VERBS


def remote_schema() -> dict[str, Any]:
    """Return the schema: messages under ``$defs``, the message of each key under ``x-keys``.

    Requests are listed by verb, with role, need of the lease, and the result of the reply.
    """
    verbs = {
        f"{kind.value}/<identity>/{name}": verb
        for kind, table in VERBS.items()
        for name, verb in table.items()
    }
    requests: dict[str, Any] = {key: request_kind(verb.arguments) for key, verb in verbs.items()}
    messages: list[Any] = [Status, RigEvent, Reply, ErrorReply]
    messages += [verb.result for verb in verbs.values()]
    messages += requests.values()
    references, schema = models_json_schema(
        [(message, "validation") for message in dict.fromkeys(messages)]
    )
    refer = {model: reference for (model, _), reference in references.items()}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"rigd remote protocol, version {VERSION}",
        "x-keys": {
            "status": refer[Status],
            "event": refer[RigEvent],
            **{
                key: {
                    "role": verb.rule.role.value,
                    "needs_lease": verb.rule.needs_lease,
                    "request": refer[requests[key]],
                    "reply": refer[Reply],
                    "result": refer[verb.result],
                    "error": refer[ErrorReply],
                }
                for key, verb in verbs.items()
            },
        },
        "$defs": schema["$defs"],
    }
