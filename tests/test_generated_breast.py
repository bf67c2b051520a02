"""A generated breast through the whole stair: is it a mammogram that comes out?"""

from __future__ import annotations

import numpy as np
import pytest
from make_run import FEW_PHOTONS
from scipy import ndimage

import mammosim


@pytest.fixture(scope="module", params=["L", "R"])
def study(request):
    breast = mammosim.generate_phantom(
        density="scattered", voxel_mm=1.2, seed=2, laterality=request.param
    )
    views = {}
    for view in ("CC", "MLO"):
        compressed = mammosim.compress(breast, view=view, model="springs", resolution_mm=3.0)
        paths = mammosim.project(compressed, pixel_mm=0.6)
        views[view] = compressed, paths, mammosim.expose(paths, seed=1, **FEW_PHOTONS)
    return breast, views


def from_chest_wall(picture: np.ndarray, breast) -> np.ndarray:
    """The picture with the chest wall on the left, turned and not mirrored."""
    return picture if breast.laterality == "L" else np.rot90(picture, 2)


def test_the_breast_stands_on_its_chest_wall_edge_and_air_is_black(study):
    breast, views = study
    for _, paths, image in views.values():
        tissue = paths.length_mm.sum(axis=0) > 5.0
        picture = from_chest_wall(image.for_presentation, breast)
        wall = from_chest_wall(tissue, breast)
        assert wall[:, 0].mean() > 0.3
        assert not wall[:, -1].any()
        air = from_chest_wall(paths.length_mm.sum(axis=0) == 0.0, breast)
        # Scatter and blur reach a little into the air beside the skin.
        assert np.median(picture[air]) == 0
        assert np.median(picture[wall]) > 500


def test_gland_is_brighter_than_fat(study):
    _, views = study
    for _, paths, image in views.values():
        gland = paths.length_mm[paths.tissues.index("gland")]
        muscle = paths.length_mm[paths.tissues.index("muscle")]
        inside = (paths.length_mm.sum(axis=0) > 0.9 * paths.thickness_mm) & (muscle == 0.0)
        # Fat is shown brighter near the skin, as on clinical images.
        inside &= ndimage.distance_transform_edt(paths.length_mm.any(axis=0)) * 0.6 > 12.0
        dense = inside & (gland > np.quantile(gland[inside], 0.95))
        fatty = inside & (gland <= np.quantile(gland[inside], 0.1))
        assert gland[dense].mean() > gland[fatty].mean() + 8.0
        grey = image.for_presentation
        assert grey[dense].mean() > grey[fatty].mean() + 400


def test_for_processing_falls_with_thickness_and_is_not_clipped(study):
    _, views = study
    for _, paths, image in views.values():
        thick = paths.length_mm.sum(axis=0) > 45.0
        air = paths.length_mm.sum(axis=0) == 0.0
        assert image.for_processing[thick].mean() < 0.2 * image.for_processing[air].mean()
        assert image.for_processing[thick].min() > 0


def test_mlo_shows_the_pectoral_muscle_as_a_triangle(study):
    breast, views = study
    _, paths, image = views["MLO"]
    # Seen with the chest wall left, superolateral is up in a left breast's picture; a right
    # breast's is turned by half a turn, which brings it down.
    muscle = from_chest_wall(paths.length_mm[paths.tissues.index("muscle")], breast)
    if breast.laterality == "R":
        muscle = muscle[::-1]
    width = (muscle > 10.0).sum(axis=1) * paths.pixel_mm
    rows = np.flatnonzero(width)
    top, bottom = rows[: rows.size // 4], rows[-rows.size // 4 :]
    assert width[top].mean() > 15.0
    assert width[bottom].mean() < 0.6 * width[top].mean()
    assert (muscle[rows[rows.size // 2]] > 10.0)[1]
    lengths = {name: paths.length_mm[paths.tissues.index(name)] for name in ("muscle", "adipose")}
    fatty = (lengths["muscle"] == 0.0) & (lengths["adipose"] > 0.8 * paths.thickness_mm)
    grey = image.for_presentation
    assert grey[lengths["muscle"] > 10.0].mean() > 1.5 * grey[fatty].mean()


def test_breast_and_muscle_run_out_of_the_oblique_picture_at_its_upper_edge(study):
    breast, views = study
    _, paths, _ = views["MLO"]
    tissue = from_chest_wall(paths.length_mm.sum(axis=0), breast)
    muscle = from_chest_wall(paths.length_mm[paths.tissues.index("muscle")], breast)
    skin = from_chest_wall(paths.length_mm[paths.tissues.index("skin")], breast)
    if breast.laterality == "R":
        tissue, muscle, skin = tissue[::-1], muscle[::-1], skin[::-1]
    width = np.count_nonzero(tissue[0] > 20.0) * paths.pixel_mm
    assert width > 25.0
    assert np.count_nonzero(muscle[0] > 10.0) * paths.pixel_mm > 10.0
    # No skin is seen edge on there but at the front: the middle has the two faces' at most.
    middle = skin[0, : np.count_nonzero(tissue[0] > 20.0) // 2]
    assert np.median(middle) < 8.0
    assert not tissue[-1].any()


def test_plates_hold_the_breast_at_its_own_height(study):
    """In CC the nipple lies between the plates, not pressed to one by the tissue above it."""
    breast, views = study
    compressed, _, _ = views["CC"]
    nipple = compressed.view.rotation @ (
        breast.nipple_mm + compressed.displacement_at(breast.nipple_mm)[0]
    )
    middle = 0.5 * (compressed.support_z_mm + compressed.paddle_z_mm)
    assert abs(nipple[2] - middle) < 0.3 * compressed.thickness_mm


def test_cc_keeps_most_of_the_muscle_out(study):
    _, views = study
    shown = {}
    for name, (_, paths, _) in views.items():
        muscle = paths.length_mm[paths.tissues.index("muscle")]
        shown[name] = muscle.sum() * paths.pixel_mm**2
    assert shown["CC"] < shown["MLO"]


def test_side_is_recognised_by_its_own_rule(study, tmp_path):
    breast, _ = study
    path = tmp_path / "breast.npz"
    np.savez(path, labels=breast.labels, voxel_mm=breast.voxel_mm, origin_mm=breast.origin_mm)
    assert mammosim.read_phantom(path).laterality == breast.laterality
