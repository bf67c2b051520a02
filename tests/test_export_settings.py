"""The `export` section."""

from __future__ import annotations

import pytest

from mammosim.config import to_settings
from mammosim.errors import InputError
from mammosim.export import ExportSettings


@pytest.mark.parametrize("found", ["20240229", 20240229, "2024-02-29"])
def test_a_date_may_be_written_as_yaml_reads_it(found):
    assert to_settings(ExportSettings, {"date": found}, "run.yaml").date == "20240229"


@pytest.mark.parametrize(
    "found", ["20230229", "today", 2000, "2000010", True, None, "２０００0101"]
)
def test_what_is_not_a_date_is_refused(found):
    with pytest.raises(InputError, match=r"export\.date: found .* expected a date as YYYYMMDD"):
        to_settings(ExportSettings, {"date": found}, "run.yaml", ("export",))


def test_every_setting_has_its_sentence():
    for name, field in ExportSettings.model_fields.items():
        assert field.description is not None, name
        assert field.description.endswith("."), name
