"""Files for 3D Slicer and ITK-SNAP, read back by the rules of their formats."""

from __future__ import annotations

import gzip
import json
import re

import numpy as np
import pytest
import SimpleITK as sitk
from make_records import make_compressed, make_phantom, make_targets

from mammosim import load_config
from mammosim.errors import InputError
from mammosim.export import ExportSettings, write_compressed, write_markups, write_phantom
from mammosim.geometry import View
from mammosim.projection import compressed_labels

CC, MLO = View("CC", "L"), View("MLO", "L")


def read_nrrd(path):
    """Header fields and voxels [slice, row, column] of an NRRD file with attached data."""
    head, data = path.read_bytes().split(b"\n\n", 1)
    first, *lines = head.decode("utf-8").splitlines()
    assert first.startswith("NRRD000")
    fields = dict(re.split(r":= ?|: ", line, maxsplit=1) for line in lines if line[0] != "#")
    assert (fields["type"], fields["encoding"]) == ("unsigned char", "gzip")
    sizes = [int(size) for size in fields["sizes"].split()]
    return fields, np.frombuffer(gzip.decompress(data), np.uint8).reshape(sizes[::-1])


@pytest.fixture(scope="module", params=[CC, MLO], ids=lambda view: view.folder)
def written(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    compressed = make_compressed(request.param)
    labels, frame = compressed_labels(compressed)
    write_phantom(compressed.phantom, folder, viewers=True)
    settings = ExportSettings(viewers=True)
    write_compressed(folder / "view", compressed, settings, labels, frame)
    return folder


@pytest.mark.parametrize("name", ["uncompressed", "view/compressed"])
def test_a_segmentation_has_a_named_and_coloured_segment_per_label(written, name):
    fields, voxels = read_nrrd(written / f"{name}.seg.nrrd")
    assert fields["space"] == "left-posterior-superior"
    assert fields["kinds"] == "domain domain domain"
    assert fields["Segmentation_SourceRepresentation"] == "Binary labelmap"
    assert fields["Segmentation_ContainedRepresentationNames"] == "Binary labelmap|"
    found = {int(fields[f"Segment{n}_LabelValue"]): fields[f"Segment{n}_Name"] for n in range(5)}
    assert found == {1: "adipose", 29: "gland", 151: "mass 1", 152: "calcs", 153: "clip A"}
    assert "Segment5_ID" not in fields
    assert {int(value) for value in np.unique(voxels)} <= {0, *found}
    last = " ".join(f"0 {size - 1}" for size in voxels.shape[::-1])
    for n in range(5):
        red, green, blue = (float(part) for part in fields[f"Segment{n}_Color"].split())
        assert all(0.0 <= part <= 1.0 for part in (red, green, blue))
        assert fields[f"Segment{n}_Layer"] == "0"
        assert fields[f"Segment{n}_Extent"] == last


@pytest.mark.parametrize("name", ["uncompressed", "view/compressed"])
def test_a_segmentation_lies_where_the_volume_lies(written, name):
    volume, segments = (
        sitk.ReadImage(str(written / f"{name}{ending}")) for ending in (".nii.gz", ".seg.nrrd")
    )
    np.testing.assert_array_equal(*map(sitk.GetArrayFromImage, (volume, segments)))
    np.testing.assert_allclose(segments.GetOrigin(), volume.GetOrigin(), atol=1e-4)
    np.testing.assert_allclose(segments.GetDirection(), volume.GetDirection(), atol=1e-6)
    np.testing.assert_allclose(segments.GetSpacing(), volume.GetSpacing(), atol=1e-6)


def test_itksnap_reads_eight_columns(written):
    lines = (written / "view" / "labels_itksnap.txt").read_text().splitlines()
    assert lines[0] == "# ITK-SnAP Label Description File"
    row = re.compile(r'\s*(\d+)\s+(\d+)\s+(\d+)\s+(\d+)\s+([\d.]+)\s+([01])\s+([01])\s+"(.*)"')
    rows = [row.fullmatch(line).groups() for line in lines if line[0] != "#"]
    assert rows[0][0] == "0"
    assert [(int(found[0]), found[-1]) for found in rows[1:]] == [
        (1, "adipose"), (29, "gland"), (151, "mass 1"), (152, "calcs"), (153, "clip A"),
    ]  # fmt: skip
    assert all(int(part) < 256 for found in rows for part in found[1:4])


@pytest.mark.parametrize("view", [CC, MLO], ids=lambda view: view.folder)
def test_markups_lie_where_the_lesions_lie(view, tmp_path):
    """Of uncompressed lesions: in the voxels of their labels."""
    phantom, targets = make_phantom("L"), make_targets(view)
    write_phantom(phantom, tmp_path)
    volume = sitk.ReadImage(str(tmp_path / "uncompressed.nii.gz"))
    points = {}
    for compressed in (False, True):
        write_markups(targets, view, compressed, tmp_path / "lesions.mrk.json")
        said = json.loads((tmp_path / "lesions.mrk.json").read_text())
        (markup,) = said["markups"]
        assert said["@schema"].endswith("markups-schema-v1.0.3.json#")
        assert (markup["type"], markup["coordinateSystem"]) == ("Fiducial", "LPS")
        points[compressed] = [point["position"] for point in markup["controlPoints"]]
        assert [p["label"] for p in markup["controlPoints"]] == [t.name for t in targets]
    for lesion, place in zip(phantom.lesions, points[False], strict=False):
        assert volume[volume.TransformPhysicalPointToIndex(place)] == lesion.label
    left, posterior, superior = np.array(points[True][0]) - points[False][0]
    shift = [targets[0].shift_x_mm, targets[0].shift_y_mm, targets[0].shift_z_mm]
    np.testing.assert_allclose([-posterior, left, superior], shift, atol=1e-3)


def test_markups_of_a_breast_in_the_compression_frame_lie_in_the_patient(tmp_path):
    view = View("MLO", "L", in_compression_frame=True)
    target = make_targets(CC)[0]
    write_markups([target], view, False, tmp_path / "lesions.mrk.json")
    said = json.loads((tmp_path / "lesions.mrk.json").read_text())
    left, posterior, superior = said["markups"][0]["controlPoints"][0]["position"]
    found = view.patient_rotation @ [-posterior, left, superior]
    np.testing.assert_allclose(found, target.place_mm, atol=1e-3)


def test_viewers_without_volumes_are_refused(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("phantom: {generate: {}}\nexport: {viewers: true, volumes: false}\n")
    with pytest.raises(InputError, match=r"export.*viewers: found true without volumes"):
        load_config(path)
