"""What a configuration says of a patient and of both breasts, and what contradicts itself."""

from __future__ import annotations

from pathlib import Path

import pytest

from mammosim.errors import InputError
from mammosim.export import PatientSettings, StudyIdentity
from mammosim.pipeline import config_of, make_plan
from mammosim.pipeline.folder.run_identity import InputHashes, hash_of

LESIONS = [
    {"name": "mass", "kind": "mass"},
    {"name": "cluster", "kind": "calcification", "laterality": "L"},
]


def config(**sections):
    values = {"phantom": {"generate": {"voxel_mm": 2.0}}, **sections}
    return config_of(values, Path("/nowhere"), "exam.yaml")


def problems(**sections) -> str:
    with pytest.raises(InputError) as caught:
        config(**sections)
    return "\n".join(caught.value.problems)


def test_an_exam_is_one_configuration_a_breast():
    both = config(phantom={"generate": {}, "lesions": LESIONS}, laterality=["R", "L"])
    right, left = both.sides
    assert [one.laterality for one in both.sides] == ["R", "L"]
    assert [lesion.name for lesion in right.phantom.lesions] == ["mass"]  # without a side: first
    assert [lesion.name for lesion in left.phantom.lesions] == ["cluster"]
    assert (right.breast_number, left.breast_number) == (0, 1)
    assert both.of_side("L") == left
    assert right == config(phantom={"generate": {}, "lesions": LESIONS[:1]}, laterality="R")


def test_files_by_side_name_the_sides():
    exam = config(phantom={"file": {"L": "left.mhd", "R": "right.mhd"}})
    assert [one.laterality for one in exam.sides] == ["R", "L"]
    assert [Path(one.phantom.file).name for one in exam.sides] == ["right.mhd", "left.mhd"]
    assert all(Path(one.phantom.file).is_absolute() for one in exam.sides)


def test_a_view_of_one_side_is_made_of_that_side_alone():
    views = ["CC", {"view": "CC", "name": "CC_spot", "laterality": "R"}]
    right, left = config(laterality=["R", "L"], views=views).sides
    assert [view.label for view in right.resolved_views] == ["CC", "CC_spot"]
    assert [view.position("L").folder for view in left.resolved_views] == ["LCC"]


def test_one_breast_is_the_run_that_it_was():
    """The hash, and with it every UID, of a run that names nothing new does not change."""
    plain = config(laterality="R", seed=3)
    assert plain.sides == (plain,)
    assert not {"patient", "name"} & plain.plain().keys()
    assert config(laterality=["R"], seed=3) == plain
    inputs = InputHashes((), (), (), ())
    assert hash_of(config(laterality=["R", "L"], seed=3), inputs) != hash_of(plain, inputs)


def test_the_plan_of_an_exam_holds_both_breasts():
    one, both = (make_plan(config(laterality=sides)) for sides in ("L", ["R", "L"]))
    named = [line.split(":")[0] for line in both.lines]
    assert named == ["R", "RCC", "RMLO", "L", "LCC", "LMLO"]
    assert both.memory_gb > one.memory_gb
    assert 1.2 * one.minutes < both.minutes < 2.5 * one.minutes


@pytest.mark.parametrize(
    ("sections", "said"),
    [
        ({"laterality": ["L", "L"]}, "laterality: found ['L', 'L'], names L twice"),
        ({"laterality": ["L", "X"]}, "expected L, R, or both as [R, L]"),
        ({"laterality": []}, "expected L, R, or both as [R, L]"),
        (
            {"laterality": "R", "phantom": {"generate": {}, "lesions": LESIONS}},
            "phantom.lesions.1.laterality: found L for 'cluster', but only R is imaged",
        ),
        (
            {"phantom": {"generate": {}, "lesions": LESIONS}},
            "which breast is imaged is not known; set laterality",
        ),
        (
            {"laterality": ["L", "R"], "phantom": {"file": "both.mhd"}},
            "both.mhd' for both breasts, expected one file per side",
        ),
        (
            {"phantom": {"file": {"L": "a.mhd", "R": "a.mhd"}}},
            "names one file for both sides; expected a file for each breast",
        ),
        (
            {"laterality": ["L", "R"], "phantom": {"file": {"L": "a.mhd"}}},
            "found files for L, expected one for each side of laterality: L, R",
        ),
        ({"phantom": {"file": {"left": "a.mhd"}}}, "expected one file, or one file per side"),
        ({"phantom": {"file": ["a.mhd"]}}, "expected one file, or one file per side"),
        (
            {"laterality": "L", "views": ["CC", {"view": "MLO", "laterality": "R"}]},
            "views.1.laterality: found R, but only L is imaged",
        ),
        (
            {"laterality": ["L", "R"], "views": [{"view": "CC", "laterality": "R"}]},
            "views: none of them is of laterality L, expected at least one",
        ),
        ({"views": ["CC", {"view": "CC", "name": "cc"}]}, "CC, cc is listed twice"),
        ({"views": [{"view": "CC", "name": "MLO"}]}, "is what another view or a series is called"),
        ({"views": [{"view": "CC", "name": "../up"}]}, "views.0.name: found '../up'"),
        (
            {"patient": {"birth_date": "19700102", "age_years": 45}},
            "patient.age_years: found 45, but patient.birth_date 19700102 gives 29 on",
        ),
        ({"patient": {"birth_date": "20010101"}}, "expected a date 0 to 130 years before"),
        ({"patient": {"birth_date": "19700230"}}, "expected a date as YYYYMMDD"),
        ({"patient": {"name": "a\\b"}}, "contains a backslash"),
        ({"patient": {"accession": "A" * 17}}, "patient.accession"),
    ],
)
def test_what_contradicts_itself_is_refused(sections, said):
    assert said in problems(**sections)


def test_runs_share_a_study_on_purpose():
    plain = [StudyIdentity(run, "x") for run in ("1a", "2b")]
    assert plain[0].study_uid != plain[1].study_uid
    assert plain[0].patient_id != plain[1].patient_id
    patient = PatientSettings(study_uid_from="screening 7")
    one, other = (StudyIdentity(run, "x", patient) for run in ("1a", "2b"))
    for shared in ("study_uid", "patient_id", "patient_name"):
        assert getattr(one, shared) == getattr(other, shared)
    assert one.uid("image", "LCC") != other.uid("image", "LCC")
    named = StudyIdentity("1a", "x", PatientSettings(study_uid_from="screening 7", id="A"))
    assert named.study_uid != one.study_uid  # two patients never share a study


def test_an_age_follows_from_the_birth_date():
    born = StudyIdentity("1a", "x", PatientSettings(birth_date="1970-01-02"))
    assert born.age_years("20000101") == 29
    assert StudyIdentity("1a", "x", PatientSettings(age_years=61)).age_years("20000101") == 61


def test_a_magnified_view_that_keeps_grid_and_large_focal_spot_is_a_warning():
    """Said before the run, of the view on a stand (1.8 times) and not of the contact view."""
    stand = {"view": "CC", "name": "mag", "support_to_detector_mm": 285}
    warnings = make_plan(config(views=["CC", stand])).warnings
    assert len(warnings) == 2
    assert "mag: focal spot of a magnified view: found 0.3 mm" in warnings[0]
    assert "mag: an anti-scatter grid in a magnified view" in warnings[1]
    usual = {**stand, "grid": False, "focal_spot_mm": 0.1}
    assert make_plan(config(views=["CC", usual])).warnings == ()


def test_iodine_behind_springs_is_a_warning():
    agent = {"acquisition": {"contrast": {}}, "views": ["CC"]}
    (warning,) = make_plan(config(**agent, compression={"model": "springs"})).warnings
    assert "CC: acquisition.contrast: springs do not conserve the volume of tissue" in warning
    assert make_plan(config(**agent)).warnings == ()
