import numpy as np
import pytest
from naive.acquisition import half_disc
from scipy.ndimage import distance_transform_edt, gaussian_filter

from mammosim.acquisition.breast_outline import without_nipple
from mammosim.acquisition.looks import FAT_GREY, LOOKS
from mammosim.acquisition.muscle import muscle_of
from mammosim.acquisition.presentation import MAXIMUM, present

PIXEL_MM = 0.2
SHAPE = (700, 400)


def compressed_breast(radius_mm=50.0, plateau=2.6):
    """Attenuation (ln) of fat, full beyond 20 mm from the edge, with a lump of gland."""
    inside = half_disc(SHAPE, PIXEL_MM, radius_mm)
    depth = distance_transform_edt(np.pad(inside, ((0, 0), (1, 0)), mode="edge"))[:, 1:] * PIXEL_MM
    part = np.clip(depth / 20.0, 0.0, 1.0)
    fat = np.where(inside, plateau * np.sqrt(1.0 - (1.0 - part) ** 2), 0.0)
    lump = np.zeros(SHAPE)
    lump[300:360, 90:150] = 0.6
    return (fat + gaussian_filter(lump, 8.0)).astype(np.float32), inside, depth


def test_air_is_black_and_fat_grey_up_to_the_skin():
    attenuation, inside, depth = compressed_breast()
    pixels = present(attenuation, PIXEL_MM).pixels
    assert not pixels[~half_disc(SHAPE, PIXEL_MM, 51.0)].any()
    fat = inside & (depth > 4.0)
    fat[250:420, 40:200] = False
    before = attenuation[fat]
    # the raw margin falls to half of the plateau and below; shown, it is fat all over, which
    # brightens towards the skin as on clinical images (0.24 to 0.36 at 3 mm)
    assert before.min() < 0.7 * before.max()
    assert pixels[fat].min() > 0.95 * FAT_GREY * MAXIMUM
    assert pixels[fat].max() < 0.36 * MAXIMUM
    assert pixels[fat & (depth > 12.0)].max() < 0.22 * MAXIMUM


def test_gland_is_brighter_than_fat():
    attenuation, _, _ = compressed_breast()
    pixels = present(attenuation, PIXEL_MM).pixels
    assert pixels[330, 120] > 0.6 * MAXIMUM
    assert pixels[330, 120] > pixels[430, 120] + 0.3 * MAXIMUM


@pytest.mark.parametrize("place", [(330, 120), (430, 120), (350, 230), (200, 60)])
def test_more_attenuation_is_brighter(place):
    attenuation, _, _ = compressed_breast()
    row, column = place
    shown = []
    for extra in (0.0, 0.1, 0.2, 0.4, 0.8):
        changed = attenuation.copy()
        changed[row - 3 : row + 4, column - 3 : column + 4] += extra
        shown.append(int(present(changed, PIXEL_MM).pixels[row, column]))
    assert np.all(np.diff(shown) > 0)


def with_nipple(attenuation, inside):
    """The same with a nipple of 10 mm (0.08 per mm, gland) that stands out by 9 mm, and where."""
    row, tip = SHAPE[0] // 2, int((50.0 + 9.0) / PIXEL_MM)
    nipple = np.zeros(SHAPE, bool)
    nipple[row - 25 : row + 25, tip - 75 : tip] = True
    return np.where(nipple, np.maximum(np.float32(0.8), attenuation), attenuation), nipple


def test_a_nipple_is_brighter_than_fat_and_joins_the_breast():
    attenuation, inside, _ = compressed_breast()
    changed, nipple = with_nipple(attenuation, inside)
    pixels = present(changed, PIXEL_MM).pixels
    row = SHAPE[0] // 2
    free = nipple & (distance_transform_edt(nipple & ~inside) * PIXEL_MM > 3.0)
    # soft tissue: between fat, 0.13, and gland, 0.64
    assert pixels[free].min() > 0.25 * MAXIMUM
    assert pixels[free].max() < 0.64 * MAXIMUM
    # along the axis, out of the breast: no dark gap
    middle = distance_transform_edt(nipple | inside)[row] * PIXEL_MM > 3.0
    shown = pixels[row, middle & (np.arange(SHAPE[1]) > 200)]
    assert shown.min() > 0.10 * MAXIMUM
    assert shown.max() < 0.70 * MAXIMUM
    bare = present(attenuation, PIXEL_MM).pixels.astype(int)
    # the margin's profile is averaged along the edge, with a Gaussian of 12 mm; the ramp of the
    # skin line over the outermost millimetre follows the whole outline
    far = np.hypot(*(np.indices(SHAPE) - [[[row]], [[250]]])) * PIXEL_MM > 40.0
    change = np.abs(pixels.astype(int) - bare)
    ramp = distance_transform_edt(inside) * PIXEL_MM < 1.0
    assert change[far & ~ramp].max() < 0.002 * MAXIMUM
    assert change[far].max() < 0.015 * MAXIMUM


def test_what_ends_at_the_chest_wall_is_no_nipple():
    """A bit of abdomen below the inframammary fold is shown as the breast beside it."""
    _, inside, _ = compressed_breast()
    _, nipple = with_nipple(np.zeros(SHAPE, np.float32), inside)
    rows, columns = np.indices(SHAPE)
    abdomen = ((rows - 620) / 60.0) ** 2 + (columns / 40.0) ** 2 < 1.0
    breast = inside | nipple | abdomen
    body = without_nipple(breast, PIXEL_MM)
    assert body[abdomen].all()
    assert not body[nipple & ~half_disc(SHAPE, PIXEL_MM, 52.0)].any()


def test_the_pointed_end_of_a_breast_is_no_nipple():
    """Half an ellipse of 60 mm by 40 mm has a radius of 27 mm at its tip, as FDA's phantom has."""
    rows, columns = np.indices(SHAPE)
    breast = np.hypot((rows - 350) / 200.0, columns / 300.0) < 1.0
    nipple = (abs(rows - 350) <= 20) & (columns < 325)  # 8 mm wide, 5 mm before the tip
    body = without_nipple(breast | nipple, PIXEL_MM)
    assert body[breast & (columns < 290)].all()
    assert not body[nipple & (columns > 310)].any()


def test_more_attenuation_in_the_nipple_is_brighter():
    changed, _ = with_nipple(*compressed_breast()[:2])
    shown = []
    for extra in (0.0, 0.05, 0.1, 0.2):
        dotted = changed.copy()
        dotted[348:353, 265:270] += extra
        shown.append(int(present(dotted, PIXEL_MM).pixels[350, 267]))
    assert np.all(np.diff(shown) > 0)


def test_a_nipple_in_profile_is_about_as_bright_as_the_skin_line():
    attenuation, depth = with_skin()
    row, (rows, columns) = SHAPE[0] // 2, np.indices(SHAPE)
    dome = np.hypot((rows - row) / 30.0, (columns - 249) / 20.0) < 1.0  # 6 mm by 4 mm
    height = np.sqrt(np.clip(1.0 - ((rows - row) / 30.0) ** 2, 0.0, 1.0)) * 10.0
    thick = np.where(dome, 0.085 * height, 0.0).astype(np.float32)
    pixels = present(np.maximum(attenuation, gaussian_filter(thick, 0.5)), PIXEL_MM).pixels
    line = at_depth(pixels, depth, 0.9, 1.3)
    middle = pixels[row - 8 : row + 9, 255:262].mean() / MAXIMUM
    assert 0.7 * line < middle < 1.15 * line


@pytest.mark.parametrize("look", ["crisp", "soft"])
def test_fine_detail_is_enhanced_more_than_wide(look):
    attenuation, _, _ = compressed_breast()
    attenuation[200:500, :150] = 2.6 + 0.3  # gland, on the straight part of the curve
    column = np.arange(150) * PIXEL_MM
    shown = []
    for wave_mm in (1.2, 4.0):
        ripple = np.zeros(SHAPE, np.float32)
        ripple[200:500, :150] = 0.01 * np.sin(2.0 * np.pi * column / wave_mm)
        pair = [present(attenuation + sign * ripple, PIXEL_MM, look=look) for sign in (1, -1)]
        change = pair[0].pixels[350].astype(int) - pair[1].pixels[350]
        shown.append(np.std(change[25:125]))
    wide, fine = LOOKS[look].gains
    sharper = 1.0 + LOOKS[look].sharpness  # of the restoration, at most
    assert 1.05 < shown[0] / shown[1] < sharper * fine / wide


def with_muscle(level):
    """A breast that runs out at the upper border, with muscle at the wall, and where it is."""
    row, column = np.indices(SHAPE)
    inside = half_disc(SHAPE, PIXEL_MM, 50.0) | ((row < 350) & (column < 160))
    depth = distance_transform_edt(np.pad(inside, ((1, 0), (1, 0)), mode="edge"))[1:, 1:]
    part = np.clip(depth * PIXEL_MM / 20.0, 0.0, 1.0)
    fat = np.where(inside, 2.6 * np.sqrt(1.0 - (1.0 - part) ** 2), 0.0)
    lump = np.zeros(SHAPE)
    lump[330:390, 90:150] = 0.3
    muscle = column < 90 - 0.3 * row
    added = gaussian_filter(lump, 8.0) + gaussian_filter(np.where(muscle, level, 0.0), 2.0)
    return (fat + added).astype(np.float32), muscle


def test_muscle_takes_no_grey_from_the_breast():
    attenuation, muscle = with_muscle(0.98)
    pixels = present(attenuation, PIXEL_MM).pixels
    without = present(with_muscle(0.0)[0], PIXEL_MM).pixels
    gland, fat = pixels[360, 120], pixels[450, 60]
    assert abs(int(gland) - int(without[360, 120])) < 0.02 * MAXIMUM
    assert abs(int(fat) - int(without[450, 60])) < 0.02 * MAXIMUM
    # muscle is brighter than gland, but far from white
    well_inside = distance_transform_edt(np.pad(muscle, ((1, 0), (1, 0)), "edge"))[1:, 1:] > 15
    assert gland < pixels[well_inside].min()
    assert pixels[well_inside].max() < 0.85 * MAXIMUM


@pytest.mark.parametrize("place", [(100, 20), (60, 67), (20, 80)])
def test_more_attenuation_in_muscle_is_brighter(place):
    row, column = place  # within it, and on its edge
    shown = []
    for extra in (-0.2, -0.1, 0.0, 0.1):
        attenuation, _ = with_muscle(0.98)
        attenuation[row - 2 : row + 3, column - 2 : column + 3] += extra
        shown.append(int(present(attenuation, PIXEL_MM).pixels[row, column]))
    assert np.all(np.diff(shown) > 0)


def test_the_muscles_edge_stays_where_it_is():
    """From fat to muscle within the blur that the edge was given, without a dark or light seam."""
    attenuation, muscle = with_muscle(0.98)
    line = present(attenuation, PIXEL_MM).pixels[100].astype(int)
    edge = int(np.flatnonzero(~muscle[100])[0])
    middle = 0.5 * (line[edge - 15] + line[edge + 15])
    assert abs(int(np.flatnonzero(line < middle)[0]) - edge) <= 2
    # local contrast enhancement overshoots on either side, by less than a twentieth of the step
    seam = 0.05 * (line[edge - 15] - line[edge + 15])
    assert line[edge : edge + 15].min() > line[edge + 15] - seam
    assert line[edge - 15 : edge].max() < line[edge - 15] + seam


def test_a_picture_full_of_gland_has_no_muscle():
    rng = np.random.default_rng(4)
    attenuation = np.float32(2.0) + gaussian_filter(rng.normal(0, 6.0, (300, 300)), 8.0)
    attenuation[:60, :200] += 1.0  # more than a third of it is as bright
    attenuation[:, :100] += 1.0
    shown = present(attenuation.astype(np.float32), PIXEL_MM).pixels
    assert shown[30, 150] < MAXIMUM


@pytest.mark.parametrize(("columns", "found"), [(40, True), (60, False)])
def test_what_fills_over_a_third_of_the_breast_is_no_muscle(columns, found):
    equalised = np.full((150, 150), 2.0)
    equalised[:, :columns] += 1.0
    muscle = muscle_of(equalised, np.ones((150, 150), bool), 2.0, 0.45, 0.4)
    assert muscle.any() == found
    assert muscle[75, 5] == found
    assert not muscle[:, columns + 6 :].any()  # its edge is 2 mm wide


def test_details_keep_their_contrast_in_the_margin():
    """A calcification 6 mm under the skin shows as strongly as one in the middle."""
    attenuation, _, depth = compressed_breast()
    changed = attenuation.copy()
    for column in (190, 207):
        assert depth[420, column] > 5.0
        changed[419:422, column - 1 : column + 2] += 0.1
    before, after = present(attenuation, PIXEL_MM).pixels, present(changed, PIXEL_MM).pixels
    gains = [int(after[420, c]) - int(before[420, c]) for c in (190, 207)]
    assert min(gains) > 0.8 * max(gains) > 0


def test_a_thin_spot_is_dark_but_not_lost():
    """What attenuates far less than fat nears black, as in film's toe, and still shows detail."""
    attenuation, _, _ = compressed_breast()
    shown = []
    for missing in (0.3, 0.4, 0.5):
        changed = attenuation.copy()
        changed[420:450, 20:50] -= missing
        shown.append(int(present(changed, PIXEL_MM).pixels[435, 35]))
    assert shown[0] > shown[1] > shown[2] > 0
    assert shown[0] < 0.14 * MAXIMUM  # fat's grey


def test_right_and_left_are_treated_alike():
    attenuation, _, _ = compressed_breast()
    turned = present(np.ascontiguousarray(attenuation[::-1, ::-1]), PIXEL_MM).pixels
    shown = present(attenuation, PIXEL_MM).pixels
    # cells are aligned with the array's corner, and the shape is a multiple of no cell
    difference = np.abs(turned[::-1, ::-1].astype(int) - shown.astype(int))
    assert np.quantile(difference, 0.999) <= 0.02 * MAXIMUM


def test_fatty_breast_is_not_stretched_to_noise():
    rng = np.random.default_rng(3)
    attenuation, inside, depth = compressed_breast()
    attenuation[250:420, 40:200] = 2.6
    attenuation += rng.normal(0.0, 0.02, SHAPE).astype(np.float32) * inside
    pixels = present(attenuation, PIXEL_MM).pixels
    # 0.02 of a range of 0.45/0.72 and more; detail of pixels is raised by the look's sharpness
    assert pixels[depth > 22.0].std() < 0.04 * (1.0 + LOOKS["crisp"].sharpness) * MAXIMUM


def test_empty_and_filled_pictures():
    empty = present(np.zeros((60, 50), np.float32), PIXEL_MM)
    assert not empty.pixels.any()
    filled = present(np.full((60, 50), 2.0, np.float32), PIXEL_MM)
    assert filled.pixels.min() == filled.pixels.max() > 0


def test_a_second_body_in_the_field_is_not_equalised():
    attenuation, _, _ = compressed_breast()
    attenuation[:20, 350:] = 0.5
    pixels = present(attenuation, PIXEL_MM).pixels
    assert not pixels[:20, 352:].any()


def with_skin(skin_mm=1.5, radius_mm=50.0, rounding_mm=22.0, gland=0.0):
    """Fat in skin between plates, its free surface half of an ellipse; gland inside 14 mm."""
    inside = half_disc(SHAPE, PIXEL_MM, radius_mm)
    depth = distance_transform_edt(np.pad(inside, ((0, 0), (1, 0)), mode="edge"))[:, 1:] * PIXEL_MM

    def chord_mm(below):
        part = np.clip(below / rounding_mm, 0.0, 1.0)
        return 2.0 * rounding_mm * np.sqrt(1.0 - (1.0 - part) ** 2)

    tissue, inner = chord_mm(depth - 0.5 * PIXEL_MM) * inside, chord_mm(depth - skin_mm)
    attenuation = 0.053 * inner + 0.085 * (tissue - inner)  # per mm, fat and skin at 28 kV
    attenuation += gland * np.clip((depth - 14.0) / 4.0, 0.0, 1.0)
    return gaussian_filter(attenuation, 0.5).astype(np.float32), depth


def at_depth(pixels, depth, low, high):
    """Median grey, as part of the range, between two depths (mm), clear of the image border."""
    clear = (np.indices(SHAPE)[1] > 50) & (depth >= low) & (depth < high)
    return float(np.median(pixels[clear])) / MAXIMUM


def test_the_skin_line_is_a_soft_ramp_on_dark_fat():
    attenuation, depth = with_skin()
    pixels = present(attenuation, PIXEL_MM).pixels
    steps = np.arange(0.1, 4.0, 0.2)
    profile = np.array([at_depth(pixels, depth, d - 0.11, d + 0.11) for d in steps])
    top = int(np.argmax(profile))
    # clinical images: 0.45 to 0.75 at 0.9 to 1.3 mm, from 10 to 90 per cent in 0.55 to 1.65 mm
    assert 0.4 < profile[top] < 0.8
    assert 0.7 < steps[top] < 1.7
    rise = np.interp([0.1, 0.9], profile[: top + 1] / profile[top], steps[: top + 1])
    assert 0.3 < np.diff(rise)[0] < 1.65
    # fat under it is brighter than deep fat, for there is more skin in the way, but no ring
    below = [at_depth(pixels, depth, d, d + 1.0) for d in (3.0, 5.0, 7.0, 10.0, 15.0, 25.0)]
    assert np.all(np.diff(below) < 0.02)
    assert below[1] < 0.5 * profile[top]


def test_known_fat_keeps_the_margin_of_a_dense_breast_dark():
    """Gland everywhere inside: the image alone cannot tell fat's level, thickness and beam can."""
    attenuation, depth = with_skin(gland=0.6)
    fat = float(with_skin()[0][350, 5])
    alone, told = (present(attenuation, PIXEL_MM, level).pixels for level in (None, fat))
    margin, gland = ([at_depth(p, depth, *mm) for p in (alone, told)] for mm in ((5, 9), (25, 40)))
    assert margin[1] < 0.5 * gland[1]
    assert margin[0] > 0.8 * gland[0]


def test_a_wrong_level_of_fat_is_held_within_what_the_image_shows():
    attenuation, depth = with_skin()
    right = present(attenuation, PIXEL_MM).pixels
    far_off = present(attenuation, PIXEL_MM, 9.0).pixels
    np.testing.assert_array_equal(far_off, right)
    with_low = present(attenuation, PIXEL_MM, 0.1).pixels
    # as if a centimetre or two of gland lay everywhere, and room for more above
    assert at_depth(with_low, depth, 25.0, 40.0) < 0.7


def test_a_place_thinner_than_fat_is_made_up_for():
    attenuation, _, _ = compressed_breast()
    changed = attenuation.copy()
    changed[420:470, 20:70] -= 0.3  # two thirds of the contrast of gland
    pixels = present(changed, PIXEL_MM).pixels
    assert pixels[445, 45] > 0.6 * present(attenuation, PIXEL_MM).pixels[445, 45]


def test_crisp_shows_details_stronger_than_soft_and_both_the_same_levels():
    attenuation, _, _ = compressed_breast()
    dotted = attenuation.copy()
    dotted[410:416, 100:106] += 0.1  # 1.2 mm
    gains, levels = {}, {}
    for look in ("crisp", "soft"):
        plain, shown = (present(a, PIXEL_MM, look=look).pixels for a in (attenuation, dotted))
        gains[look] = int(shown[413, 103]) - int(plain[413, 103])
        levels[look] = int(plain[413, 103])
    assert gains["crisp"] > 1.2 * gains["soft"] > 0
    assert abs(levels["crisp"] - levels["soft"]) < 0.01 * MAXIMUM


def test_window_covers_the_picture():
    attenuation, _, _ = compressed_breast()
    shown = present(attenuation, PIXEL_MM)
    assert shown.pixels.dtype == np.uint16
    low = shown.window_center - shown.window_width / 2
    assert low <= 0 <= shown.pixels.max() <= low + shown.window_width


def test_levels_are_those_of_what_a_spot_paddle_presses():
    """Tissue that rises beside the paddle leaves gland under it as bright as without."""
    attenuation, inside, _ = compressed_breast()
    place = np.s_[250:420, 60:180]
    under = np.zeros(SHAPE, bool)
    under[place] = True
    risen = np.where(inside & ~under, attenuation + 1.2, attenuation).astype(np.float32)
    region = under[::10, ::10]
    plain, told, alone = (
        present(image, PIXEL_MM, fat=2.6, region=mask).pixels[330, 120] / MAXIMUM
        for image, mask in ((risen, None), (risen, region), (attenuation, None))
    )
    assert plain < alone - 0.1
    assert told == pytest.approx(alone, abs=0.06)


@pytest.mark.parametrize("upside_down", [False, True])
def test_gland_that_touches_the_muscle_is_not_muscle(upside_down):
    """A wedge of muscle that narrows along the wall, and a ball of gland of nearly its level."""
    row, column = np.mgrid[:200, :150]
    muscle = column < 50 - 0.4 * row
    gland = (row - 100) ** 2 + (column - 70) ** 2 < 55**2
    level = np.where(muscle, 1.0, np.where(gland, 0.9, 0.0))
    if upside_down:
        level, muscle, gland = level[::-1], muscle[::-1], gland[::-1]
    found = muscle_of(2.0 + level, np.ones(level.shape, bool), 2.0, 0.45, 0.4)
    assert (found & muscle).sum() > 0.95 * muscle.sum()
    assert (found & gland & ~muscle).sum() < 0.15 * gland.sum()


def test_a_front_that_runs_into_gland_goes_on_straight():
    """As in a dense breast, whose gland is as bright as muscle and covers its lower end."""
    row, column = np.indices((300, 150))
    equalised = np.where((column < 50) & (row < 100), 3.0, 2.0)
    equalised[100:250, :130] = 2.9
    muscle = muscle_of(equalised, np.ones((300, 150), bool), 2.0, 0.45, 0.5)
    assert muscle[:90, :45].all()
    assert muscle[120, 30]
    assert not muscle[100:, 65:].any()
    assert not muscle[220:].any()


def test_the_skin_line_rises_over_more_where_the_margin_is_wide():
    rises = []
    for rounding_mm in (12.0, 30.0):
        attenuation, depth = with_skin(rounding_mm=rounding_mm)
        pixels = present(attenuation, PIXEL_MM, 2.6).pixels
        rises.append(at_depth(pixels, depth, 0.5, 0.9) / at_depth(pixels, depth, 1.9, 2.3))
    assert rises[1] < 0.9 * rises[0]


def test_thicker_skin_makes_a_brighter_line():
    """It varies along the outline as the skin does, and is nowhere lost."""
    lines = []
    for skin_mm in (0.9, 1.5, 2.2):
        attenuation, depth = with_skin(skin_mm)
        pixels = present(attenuation, PIXEL_MM, 2.6).pixels
        lines.append(at_depth(pixels, depth, 0.9, 1.3))
    assert lines[0] > 2.5 * FAT_GREY
    assert lines[1] > 1.1 * lines[0]
    assert lines[2] > 1.05 * lines[1]


def test_no_line_crosses_the_base_of_a_nipple():
    """The breast's own edge, seen through the nipple, ends in what is evenly bright."""
    attenuation, _ = with_skin()
    rows, columns = np.indices(SHAPE)
    row, edge = SHAPE[0] // 2, 250
    plug = (abs(rows - row) < 25) & (columns > edge - 40) & (columns < edge + 20)
    thick = gaussian_filter(np.where(plug, np.float32(0.6), np.float32(0.0)), 0.5)
    pixels = present(np.maximum(attenuation, thick), PIXEL_MM, 2.6).pixels
    line = pixels[row - 5 : row + 6, edge - 6 : edge + 12].mean(axis=0) / MAXIMUM
    assert line.max() - line.min() < 0.15
