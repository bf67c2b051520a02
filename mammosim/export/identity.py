"""Who a simulated study is about: names and identifiers that follow from the run alone."""

from __future__ import annotations

import hashlib
import uuid
from dataclasses import dataclass, field

from mammosim.export.patient_settings import PatientSettings, age_on

_NAMESPACE = uuid.UUID("6f1c35f2-9d4b-5c9e-8a63-1f0f3a7c2b11")
"""Name space of the UUIDs; any fixed one serves, and changing it changes every UID."""


@dataclass(frozen=True)
class StudyIdentity:
    """Identity of one run: one simulated patient, one study.

    Parameters
    ----------
    run_hash : str
        Hash of everything that decides the run's result (see `mammosim.report.run_hash`), so that
        a rerun has the same identifiers and another run has others.
    description : str
        What the study shows, one line.
    patient : PatientSettings, optional
        What is said of the patient and of the study.
    """

    run_hash: str
    description: str = "Simulated mammography"
    patient: PatientSettings = field(default_factory=PatientSettings)

    @property
    def patient_id(self) -> str:
        """Patient ID; where it is not given, it says that it is simulated."""
        return self.patient.id or f"SIMULATED-{self._study_hash[:12]}"

    @property
    def patient_name(self) -> str:
        """Patient name; where it is not given, it says that it is simulated."""
        return self.patient.name or f"Simulated^{self._study_hash[:12]}"

    @property
    def study_description(self) -> str:
        """Study Description."""
        return self.patient.study_description or self.description

    @property
    def study_uid(self) -> str:
        """Study Instance UID: of this run alone, or of all that share `study_uid_from`.

        Runs that share it under other Patient IDs are other studies.
        """
        shared = self.patient.study_uid_from
        if shared is None:
            return self.uid("study")
        return _uid_of("/".join(("shared study", shared, self.patient_id)))

    def age_years(self, day: str) -> int | None:
        """The patient's age on a day (YYYYMMDD), years; None where it is not known."""
        if self.patient.birth_date is not None:
            return age_on(self.patient.birth_date, day)
        return self.patient.age_years

    def uid(self, *parts: str) -> str:
        """DICOM UID of a part of the run.

        Parameters
        ----------
        *parts : str
            What it identifies, as ``("image", "LCC", "presentation")``.

        Returns
        -------
        str
            A name-based UUID under the root 2.25 (PS3.5 annex B.2), at most 44 characters.

        Examples
        --------
        >>> StudyIdentity("a1").uid("study") == StudyIdentity("a1").uid("study")
        True
        """
        return _uid_of("/".join((self.run_hash, *parts)))

    @property
    def _study_hash(self) -> str:
        shared = self.patient.study_uid_from
        if shared is None:
            return self.run_hash
        return hashlib.sha256(shared.encode("utf-8")).hexdigest()


def _uid_of(name: str) -> str:
    return f"2.25.{uuid.uuid5(_NAMESPACE, name).int}"


IMPLEMENTATION_UID = _uid_of("mammosim implementation")
"""Implementation Class UID in the files' meta header."""
