"""Who a simulated study is about: names and identifiers that follow from the run alone."""

from __future__ import annotations

import uuid
from dataclasses import dataclass

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
    """

    run_hash: str
    description: str = "Simulated mammography"

    @property
    def patient_id(self) -> str:
        """Patient ID; says that it is simulated."""
        return f"SIMULATED-{self.run_hash[:12]}"

    @property
    def patient_name(self) -> str:
        """Patient name; says that it is simulated."""
        return f"Simulated^{self.run_hash[:12]}"

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
        name = "/".join((self.run_hash, *parts))
        return f"2.25.{uuid.uuid5(_NAMESPACE, name).int}"


IMPLEMENTATION_UID = f"2.25.{uuid.uuid5(_NAMESPACE, 'mammosim implementation').int}"
"""Implementation Class UID in the files' meta header."""
