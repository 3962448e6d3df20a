"""One filter and one order of names for all listings of scans."""

import numpy as np
import pytest

from deepring.data.readers import open_session
from deepring.data.scans.bag_files import bag_scans
from deepring.data.scans.listing import list_scans
from deepring.data.scans.names import files_with, is_visible
from deepring.data.scans.records import XYZI
from deepring.data.scans.scan_files import scan_files
from helpers.bags import message, write_bag
from helpers.cli import deepring, refused

SCAN = np.ones((4, 4), "<f4").tobytes()
OTHERS = ["._000001.bin", ".000009.bin", ".000007.bin.part", "~000001.bin", ".DS_Store"]


@pytest.fixture
def folder(tmp_path):
    """Scans 2 and 10, and what systems and programs leave beside them."""
    scans = tmp_path / "velodyne"
    scans.mkdir()
    for name in ("2.bin", "10.BIN", *OTHERS, "3.bin.part", "4.bin.crdownload", "5.bin~"):
        (scans / name).write_bytes(SCAN)
    (scans / "desktop.ini").touch()
    (scans / "Thumbs.db").touch()
    (scans / "$RECYCLE.BIN").mkdir()
    (scans / "7.bin").mkdir()
    return scans


def test_all_listings_take_the_same_files_in_the_same_order(folder):
    expected = ["2.bin", "10.BIN"]
    assert [file.name for file in files_with(folder, (".bin",))] == expected
    assert [file.name for file in scan_files([folder])] == expected
    listing = list_scans(folder, XYZI)
    assert [file.name for file in listing.files] == expected
    assert not listing.broken
    (folder.parent / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2)
    (folder.parent / "drive.yaml").write_text(
        "scans: velodyne\nposes: poses.txt\nformat: kitti\nsensor_height: 1.7\n"
    )
    session = open_session("custom", folder.parent / "drive.yaml")
    assert [file.name for file in session.files] == expected


@pytest.mark.parametrize("name", OTHERS)
def test_hidden_names(name):
    assert not is_visible(name)


def test_a_link_to_nothing_is_a_broken_scan_and_not_left_out(folder):
    (folder / "11.bin").symlink_to(folder / "gone.bin")
    assert scan_files([folder])[-1].name == "11.bin"
    (reason,) = list_scans(folder, XYZI).broken
    assert "11.bin: cannot be read" in reason


def test_a_number_stands_for_one_scan(folder):
    (folder / "02.bin").write_bytes(SCAN)
    listing = list_scans(folder, XYZI)
    assert len(listing.files) == len(set(listing.numbers.tolist())) == 2
    (reason,) = listing.broken
    assert reason.endswith("2.bin: the number is that of 02.bin, too")


def test_bags_are_no_scans_of_a_drive(folder):
    """A drive's folder may also contain the bag that its scans are from."""
    (folder / "drive.bag").write_bytes(b"#ROSBAG V2.0\n")
    (folder.parent / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2)
    (folder.parent / "drive.yaml").write_text(
        "scans: velodyne\nposes: poses.txt\nformat: kitti\nsensor_height: 1.7\n"
    )
    assert len(open_session("custom", folder.parent / "drive.yaml")) == 2


def test_a_bag_does_with_files_of_systems_beside_its_own(tmp_path):
    bag = write_bag(tmp_path, "folder", {"/points": [message(np.ones((4, 3)))]})
    (bag / "._drive.db3").write_bytes(b"\0\5\x16\7" + bytes(60))
    (scan,) = bag_scans(bag)
    assert len(scan.read()) == 4


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_endings_of_bags_may_be_upper_case(tmp_path, kind):
    bag = write_bag(tmp_path, kind, {"/points": [message(np.ones((4, 3)))]})
    upper = bag.rename(tmp_path / f"DRIVE.{kind.upper()}")
    assert scan_files([tmp_path]) == [upper]
    assert len(list(bag_scans(upper))) == 1


def test_a_file_of_metadata_is_no_scan_even_if_named(folder, tmp_path):
    (folder / "._2.bin").write_bytes(b"\0\5\x16\7" + bytes(60))
    arguments = ("case-study", "--format", "kitti", folder / "._2.bin", "-o", tmp_path / "out")
    refused(deepring(*arguments, cwd=tmp_path), "is a file of macOS's metadata, not a scan")
