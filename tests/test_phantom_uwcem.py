"""Phantoms of the Wisconsin repository, and label maps whose values are no whole numbers."""

from __future__ import annotations

import numpy as np
import pytest
from make_phantom import half_ellipsoid_breast
from make_run import invoke
from make_volumes import save_uwcem

from mammosim.errors import InputError
from mammosim.phantom import read_phantom
from mammosim.tissues import TISSUES


def breast():
    """Half an ellipsoid on a wall of muscle, as the repository's are."""
    labels = half_ellipsoid_breast(voxel_mm=2.0).labels
    return np.concatenate([np.full((3, *labels.shape[1:]), 40, np.uint8), labels])


def test_media_are_tissues_and_the_nipple_is_anterior(tmp_path):
    labels = breast()
    labels[6:9, 15:18, 14:16] = 88  # stands for transitional tissue
    made = read_phantom(save_uwcem(tmp_path / "mtype.txt", labels))
    assert made.voxel_mm.tolist() == [0.5, 0.5, 0.5]
    # Which way the other axes run is not known: a right-handed order is taken.
    expected = np.where(labels == 88, TISSUES["gland_half"].label, labels)[:, ::-1]
    np.testing.assert_array_equal(made.labels, expected)
    assert made.nipple_mm[0] > made.origin_mm[0] + 0.4 * made.voxel_mm[0] * len(labels)


def test_a_label_map_of_numbers_for_any_file(tmp_path):
    codes = np.array([0.0, 3.25, 29.5])[np.searchsorted([0, 1, 29], np.minimum(breast(), 29))]
    np.savez(
        tmp_path / "b.npz", labels=codes.astype(np.float32), voxel_mm=1.0, origin_mm=np.zeros(3)
    )
    (tmp_path / "map.yaml").write_text("0: air\n3.25: adipose\n29.5: gland\n")
    made = read_phantom(tmp_path / "b.npz", str(tmp_path / "map.yaml"))
    np.testing.assert_array_equal(np.unique(made.labels), [0, 1, 29])
    (tmp_path / "map.yaml").write_text("0: air\n3.25: adipose\n")
    with pytest.raises(InputError, match=r"label 29\.5 \(.* mL\) is not in the label map"):
        read_phantom(tmp_path / "b.npz", str(tmp_path / "map.yaml"))
    (tmp_path / "map.yaml").write_text("0: air\n3.2: adipose\n29.5: gland\n")
    with pytest.raises(InputError, match=r"holds the value 3\.25, expected labels of at most 1 de"):
        read_phantom(tmp_path / "b.npz", str(tmp_path / "map.yaml"))


def test_converted_to_labels_of_our_own(tmp_path):
    save_uwcem(tmp_path / "mtype.txt", breast())
    result = invoke("convert", tmp_path / "mtype.txt", tmp_path / "b.nii.gz")
    assert result.exit_code == 0, result.output
    assert np.array_equal(read_phantom(tmp_path / "b.nii.gz").labels, breast())


@pytest.mark.parametrize(
    ("content", "info", "message"),
    [
        ("-1\n-2\n", None, "UWCEM's breastInfo.txt beside"),
        ("-1\n" * 8, "s1=2\ns2=2\n", "found no size, expected lines s1="),
        ("-1\n" * 7 + " \n" * 3, "s1=2\ns2=2\ns3=2\n", "holds 7 values, expected 8 for 2 x 2 x 2"),
        ("-1\n" * 9, "s1=2\ns2=2\ns3=2\n", "holds 9 values, expected 8"),
        ("-1\n" * 7 + "fat\n", "s1=2\ns2=2\ns3=2\n", "expected one number per line"),
        ("-1\n" * 7 + "1.15\n", "s1=2\ns2=2\ns3=2\n", r"holds the value 1\.15, expected labels of"),
        ("-1\n" * 7 + "5\n", "s1=2\ns2=2\ns3=2\n", r"label 5 \(.*is not in the label map"),
        ("-1\n", "s1=900\ns2=900\ns3=900\n", "bytes cannot hold the"),
    ],
)
def test_files_that_cannot_be_used(content, info, message, tmp_path):
    (tmp_path / "mtype.txt").write_text(content)
    if info is not None:
        (tmp_path / "breastInfo.txt").write_text(info)
    with pytest.raises(InputError, match=message):
        read_phantom(tmp_path / "mtype.txt")
