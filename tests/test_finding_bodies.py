"""Findings in healthy breasts become voxels."""

from __future__ import annotations

import numpy as np
import pytest

from mammosim.phantom.anatomy._block_kernels import Lattice
from mammosim.phantom.anatomy.finding_bodies import CALCIFIED, Ball, paint_findings
from mammosim.tissues import TISSUES

FAT = TISSUES["adipose"].label
SHARE = {TISSUES[tissue].label: share for share, tissue in CALCIFIED}


def fat(voxel_mm):
    axis = voxel_mm * np.arange(round(12.0 / voxel_mm), dtype=float)
    start = np.array([0, axis.size])
    lattice = Lattice(axis, axis, axis, np.zeros(3), 2.0, start, start, start)
    return np.full((axis.size,) * 3, FAT, np.uint8), lattice


def plaque(centre_mm, into=()):
    turn = np.linalg.qr(np.array([[1.0, 0.3, 0.2], [0.1, 1.0, 0.4], [0.3, 0.2, 1.0]]))[0]
    size = np.array([1.0, 0.09, 0.5])
    return Ball(np.asarray(centre_mm), size, turn, "benign_calcification", into)


def calcified(labels):
    return sum(share * int((labels == label).sum()) for label, share in SHARE.items())


@pytest.mark.parametrize("voxel_mm", [0.2, 0.4])
def test_a_plaque_thinner_than_a_voxel_keeps_its_volume_in_parts_of_voxels(voxel_mm):
    labels, lattice = fat(voxel_mm)
    for place in np.ndindex(3, 3, 3):
        paint_findings(labels, lattice, [plaque(3.0 + 3.1 * np.array(place))])
    wanted = 27 * 4.0 / 3.0 * np.pi * 1.0 * 0.09 * 0.5 / voxel_mm**3
    assert calcified(labels) == pytest.approx(wanted, rel=0.05)
    # Its whole width is 0.18 mm: no voxel of 0.4 mm holds more than half of it.
    whole = (labels == TISSUES["benign_calcification"].label).sum()
    assert whole == 0 if voxel_mm == 0.4 else whole < 0.3 * (labels != FAT).sum()


def test_a_voxel_keeps_the_greater_of_two_parts():
    labels, lattice = fat(0.4)
    stone = Ball(np.full(3, 6.0), np.full(3, 1.0), np.eye(3), "benign_calcification")
    paint_findings(labels, lattice, [stone])
    alone = labels.copy()
    paint_findings(labels, lattice, [plaque((6.0, 6.0, 6.0))])
    before, after = (np.vectorize(lambda one: SHARE.get(one, 0.0))(a) for a in (alone, labels))
    assert (after >= before).all()
    assert (after > before).any()


def test_within_skin_voxels_are_whole():
    labels, lattice = fat(0.4)
    labels[:] = TISSUES["skin"].label
    paint_findings(labels, lattice, [plaque((6.0, 6.0, 6.0), into=("skin",))])
    found = set(np.unique(labels).tolist())
    assert found == {TISSUES["skin"].label, TISSUES["benign_calcification"].label}
