"""Reads the links (shared connections) of a rig file and checks them against the devices.

Each device must use a link of a kind that fits.
"""

from __future__ import annotations

from rigd.config.binding import bind
from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.registry import find_link
from rigd.config.rig import LinkSetup
from rigd.config.source import DeviceSource, RigSource
from rigd.model.errors import ConfigError


def read_links(
    document: Document, source: RigSource, problems: Problems
) -> dict[str, LinkSetup | None]:
    """Return every link by name; None for a wrong link, so that its devices report no error."""
    links: dict[str, LinkSetup | None] = {}
    for name, link in source.links.items():
        path: KeyPath = ("links", name)
        links[name] = None
        try:
            link_class = find_link(link.type)
        except ConfigError as error:
            problems.add(document.place((*path, "type")), error.message, error.hint)
            continue
        config = bind(document, link_class.Config, problems, (*path, "options"), data=link.options)
        if config is not None:
            links[name] = LinkSetup(name, link.type, link_class, config)
    return links


def check_link(
    document: Document,
    path: KeyPath,
    source: DeviceSource,
    kind: str,
    links: dict[str, LinkSetup | None],
    problems: Problems,
) -> None:
    """Check that the device names a link of the right kind if its driver needs a link."""
    fitting = [name for name, link in links.items() if link and link.link_class.kind == kind]
    if source.link is None:
        if kind:
            problems.add(
                document.place((*path, "driver")),
                f"{source.driver} needs a link of kind {kind}",
                f"add 'link: {fitting[0]}'" if fitting else
                "add one under `links:` and 'link: NAME' here",
            )  # fmt: skip
        return
    place = document.place((*path, "link"))
    if source.link not in links:
        problems.add(place, f"unknown link {source.link!r}", suggest(source.link, links))
    elif not kind:
        problems.add(place, f"{source.driver} takes no link", "remove this line")
    elif links[source.link] is not None and source.link not in fitting:
        setup = links[source.link]
        given = "" if setup is None else setup.link_class.kind
        problems.add(
            place,
            f"{source.link} is a link of kind {given}, {source.driver} needs {kind}",
            f"links of that kind: {', '.join(fitting) or 'none in this file'}",
        )
