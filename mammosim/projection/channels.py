"""Channels of the projection: one for each material of the phantom, one for each lesion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom import BreastPhantom, Lesion, label_counts
from mammosim.tissues import TISSUES, Tissue


@dataclass(frozen=True, eq=False)
class Channels:
    """What is traced apart.

    Parameters
    ----------
    names, materials : tuple of str
        Name of each channel, and the material that it attenuates as.
    lesions : tuple of Lesion or None
        Lesion that each channel is, None where it is a material.
    of_label : ndarray of int64, (256,)
        Channel of each label; mixtures have their own channels after the named ones, air the
        one after those.
    shares : ndarray of float32, (mixtures, ``len(names)``)
        Part of each material in the mixtures, in the order of their channels.
    """

    names: tuple[str, ...]
    materials: tuple[str, ...]
    lesions: tuple[Lesion | None, ...]
    of_label: NDArray[np.int64]
    shares: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def lesion_labels(self) -> tuple[int, ...]:
        """Label of the lesion that each channel is, 0 where it is none."""
        return tuple(0 if lesion is None else lesion.label for lesion in self.lesions)


def channels_of(phantom: BreastPhantom) -> Channels:
    """Materials that occur in a phantom, in the order of the tissue table, then its lesions.

    Parameters
    ----------
    phantom : BreastPhantom

    Raises
    ------
    InputError
        If a label occurs that has no tissue.
    """
    present = np.flatnonzero(label_counts(phantom).any(axis=0))
    unknown = [int(label) for label in present if int(label) not in phantom.tissue_of_label]
    if unknown:
        raise InputError(f"phantom: found voxels with label {unknown}, which belongs to no tissue")
    of_lesion = {lesion.label: lesion for lesion in phantom.lesions}
    tissue_of = {
        int(label): TISSUES[phantom.tissue_of_label[int(label)]]
        for label in present
        if int(label) not in of_lesion
    }
    material_of = {label: tissue.material for label, tissue in tissue_of.items()}
    mixed = {label: _materials_of(tissue) for label, tissue in tissue_of.items() if tissue.mixture}
    found = {*material_of.values(), *(name for parts in mixed.values() for name in parts)}
    in_table_order = dict.fromkeys(tissue.material for tissue in TISSUES.values())
    materials = [name for name in in_table_order if name and name in found]
    lesions = [lesion for lesion in phantom.lesions if TISSUES[lesion.tissue].material]
    named = len(materials) + len(lesions)
    of_label = np.full(256, named + len(mixed), dtype=np.int64)
    shares = np.zeros((len(mixed), named), np.float32)
    for order, (label, parts) in enumerate(mixed.items()):
        of_label[label] = named + order
        for name, part in parts.items():
            shares[order, materials.index(name)] += part
    for label, material in material_of.items():
        if material is not None:
            of_label[label] = materials.index(material)
    for order, lesion in enumerate(lesions):
        of_label[lesion.label] = len(materials) + order
    return Channels(
        (*materials, *(lesion.name for lesion in lesions)),
        (*materials, *(str(TISSUES[lesion.tissue].material) for lesion in lesions)),
        (*(None for _ in materials), *lesions),
        of_label,
        shares,
    )


def _materials_of(mixture: Tissue) -> dict[str, float]:
    """Part of each material in a tissue that is a mixture."""
    return {str(TISSUES[name].material): part for name, part in mixture.mixture.items()}


def host_channel(phantom: BreastPhantom, lesion: Lesion, channels: Channels) -> int | None:
    """Channel of the material that most of a lesion's neighbouring voxels are of.

    It is what fills the rest of the voxels of a lesion whose `fill` is below 1.

    Parameters
    ----------
    phantom : BreastPhantom
    lesion : Lesion
        A lesion of the phantom.
    channels : Channels

    Returns
    -------
    int or None
        None where no neighbour is of a material.
    """
    planes = np.flatnonzero(label_counts(phantom)[:, lesion.label])
    if planes.size == 0:
        return None
    slab = slice(max(int(planes[0]) - 1, 0), int(planes[-1]) + 2)
    inside = phantom.labels[slab] == lesion.label
    around = inside.copy()
    for axis in range(3):
        ahead = [slice(None)] * 3
        behind = [slice(None)] * 3
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        around[tuple(ahead)] |= inside[tuple(behind)]
        around[tuple(behind)] |= inside[tuple(ahead)]
    neighbours = channels.of_label[phantom.labels[slab][around & ~inside]]
    materials, mixtures = channels.lesion_labels.count(0), len(channels.shares)
    found = np.bincount(neighbours, minlength=len(channels) + mixtures + 1)
    counts = found[:materials] + found[len(channels) : -1] @ channels.shares[:, :materials]
    return int(counts.argmax()) if counts.any() else None
