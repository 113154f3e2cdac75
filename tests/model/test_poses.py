"""Poses are found by the names and units of channels alone."""

from __future__ import annotations

from rigd.model.channels import Channel, Stream
from rigd.model.poses import Pose, poses_of


def stream(name: str, **units: str) -> Stream:
    return Stream(name, tuple(Channel(channel, unit) for channel, unit in units.items()))


def test_pose_of_one_body_has_name_of_stream() -> None:
    marker = stream("marker", frame="count", y="m", x="m", heading="rad")
    assert poses_of([marker]) == (Pose("marker", "marker", "x", "y", "heading"),)


def test_bodies_of_one_stream_are_told_apart() -> None:
    camera = stream("camera", cart_x="m", cart_y="m", x_arm="m", y_arm="m", heading_arm="rad")
    assert poses_of([camera]) == (
        Pose("camera cart", "camera", "cart_x", "cart_y", None),
        Pose("camera arm", "camera", "x_arm", "y_arm", "heading_arm"),
    )


def test_channels_that_are_no_position_are_no_pose() -> None:
    streams = [
        stream("accelerometer", x="m/s^2", y="m/s^2"),
        stream("guide", x="m"),
        stream("mixed", x="m", y="rad"),
        stream("box", max="m", may="m"),
    ]
    assert poses_of(streams) == ()


def test_heading_in_another_unit_is_left_out() -> None:
    (pose,) = poses_of([stream("marker", x="m", y="m", heading="1")])
    assert pose.heading is None
