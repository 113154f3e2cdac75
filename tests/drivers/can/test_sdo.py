"""SDO transfers against bytes as CiA 301 (4.2.0), section 7.2.4.3, lays them out."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd_drivers.can.canopen.sdo import Aborted, Download, Garbled, Upload


def frame(text: str) -> bytes:
    return bytes.fromhex(text)


def test_expedited_upload_reads_device_type_of_servo() -> None:
    transfer = Upload(0x1000, 0)
    assert transfer.request == frame("40 00 10 00 00 00 00 00")
    assert transfer.feed(frame("43 00 10 00 92 01 02 00")) is None
    assert transfer.done
    assert transfer.data == frame("92 01 02 00")


@pytest.mark.parametrize(
    ("reply", "data"),
    [
        ("4F 61 60 00 0A 00 00 00", "0A"),  # one byte, size indicated
        ("4B 41 60 00 37 12 00 00", "37 12"),  # two
        ("47 41 60 00 37 12 01 00", "37 12 01"),  # three
        ("42 41 60 00 37 12 01 00", "37 12 01 00"),  # size not indicated: all four
    ],
)
def test_expedited_upload_returns_only_the_stated_size(reply: str, data: str) -> None:
    answer = frame(reply)
    transfer = Upload(int.from_bytes(answer[1:3], "little"), 0)
    transfer.feed(answer)
    assert transfer.data == frame(data)


@pytest.mark.parametrize(
    ("reply", "data"),
    [
        ("42 41 60 00 37 16 EE EE", "37 16"),  # size not indicated
        ("43 41 60 00 37 16 EE EE", "37 16 EE EE"),  # four bytes
    ],
)
def test_only_a_reply_without_size_is_cut(reply: str, data: str) -> None:
    transfer = Upload(0x6041, 0)
    transfer.feed(frame(reply))
    assert transfer.value(2) == frame(data)


def test_segmented_upload_toggles_and_stops_at_last_segment() -> None:
    transfer = Upload(0x1008, 0)
    assert transfer.request == frame("40 08 10 00 00 00 00 00")
    assert transfer.feed(frame("41 08 10 00 1A 00 00 00")) == frame("60 00 00 00 00 00 00 00")
    assert transfer.feed(frame("00 54 69 6E 79 20 4E 6F")) == frame("70 00 00 00 00 00 00 00")
    assert transfer.feed(frame("10 64 65 20 2D 20 4D 65")) == frame("60 00 00 00 00 00 00 00")
    assert transfer.feed(frame("00 67 61 20 44 6F 6D 61")) == frame("70 00 00 00 00 00 00 00")
    assert transfer.feed(frame("15 69 6E 73 20 21 00 00")) is None
    assert transfer.done
    assert transfer.data == b"Tiny Node - Mega Domains !"


@pytest.mark.parametrize(
    ("data", "request_"),
    [
        ("0A", "2F 60 60 00 0A 00 00 00"),
        ("E8 03", "2B 17 10 00 E8 03 00 00"),
        ("64 00 7F 00", "23 16 10 01 64 00 7F 00"),
    ],
)
def test_expedited_download_contains_its_size(data: str, request_: str) -> None:
    expected = frame(request_)
    transfer = Download(int.from_bytes(expected[1:3], "little"), expected[3], frame(data))
    assert transfer.request == expected
    assert transfer.feed(b"\x60" + expected[1:4] + bytes(4)) is None
    assert transfer.done


def test_long_value_is_downloaded_in_segments() -> None:
    transfer = Download(0x1008, 0, b"Nine byte")
    assert transfer.request == frame("21 08 10 00 09 00 00 00")
    first = transfer.feed(frame("60 08 10 00 00 00 00 00"))
    assert first == frame("00 4E 69 6E 65 20 62 79")  # 7 bytes, more follow
    second = transfer.feed(frame("20 00 00 00 00 00 00 00"))
    assert second == frame("1B 74 65 00 00 00 00 00")  # toggle, 5 unused, the last
    assert transfer.feed(frame("30 00 00 00 00 00 00 00")) is None
    assert transfer.done


def test_abort_code_is_explained() -> None:
    with pytest.raises(Aborted, match="0x06090030, the value is out of range") as caught:
        Download(0x6060, 0, b"\x0a").feed(frame("80 60 60 00 30 00 09 06"))
    assert caught.value.code == 0x06090030


@pytest.mark.parametrize(
    ("reply", "why"),
    [
        ("43 18 10 04 01 00 00 00", "for 1018:04, expected 1000:00"),
        ("60 00 10 00 00 00 00 00", "begins with 0x60"),
        ("43 00 10 00", "4 bytes, expected 8"),
    ],
)
def test_an_upload_takes_no_other_reply(reply: str, why: str) -> None:
    with pytest.raises(Garbled, match=why):
        Upload(0x1000, 0).feed(frame(reply))


def test_wrong_toggle_is_refused_and_aborted_with_code() -> None:
    transfer = Upload(0x1008, 0)
    transfer.feed(frame("41 08 10 00 0E 00 00 00"))
    with pytest.raises(Garbled, match="toggle"):
        transfer.feed(frame("10 54 69 6E 79 20 4E 6F"))
    assert transfer.abort(0x05030000) == frame("80 08 10 00 00 00 03 05")


def test_value_of_another_length_than_announced_is_refused() -> None:
    transfer = Upload(0x1008, 0)
    transfer.feed(frame("41 08 10 00 08 00 00 00"))
    with pytest.raises(Garbled, match="7 bytes came, 8 were announced"):
        transfer.feed(frame("01 54 69 6E 79 20 4E 6F"))


def test_upload_longer_than_its_limit_fails() -> None:
    transfer = Upload(0x1008, 0, limit=10)
    transfer.feed(frame("41 08 10 00 FF FF 00 00"))
    transfer.feed(frame("00 54 69 6E 79 20 4E 6F"))
    with pytest.raises(Garbled, match="longer than 10"):
        transfer.feed(frame("10 54 69 6E 79 20 4E 6F"))


@given(st.lists(st.binary(max_size=9), max_size=20), st.sampled_from([1, 4, 5, 40]))
def test_transfer_ends_or_fails_with_any_input(replies: list[bytes], size: int) -> None:
    for transfer in (Upload(0x1008, 0, limit=30), Download(0x1008, 0, bytes(size))):
        for reply in replies:
            try:
                request = transfer.feed(reply)
            except (Aborted, Garbled):
                break
            assert (request is None) is transfer.done
            if request is None:
                break
            assert len(request) == 8
