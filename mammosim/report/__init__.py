"""What a run says about itself: the record in run.json and the HTML page."""

from mammosim.report.cohort_page import render_cohort
from mammosim.report.contact_sheet import Thumbnails, contact_sheet
from mammosim.report.keys import ReportKeys
from mammosim.report.page import ReportedView, render_report
from mammosim.report.record import NOT_HASHED, Status, file_hash, run_hash, run_record
from mammosim.report.references import REFERENCES, Reference, references_used
from mammosim.report.settings import ReportSettings

__all__ = [
    "NOT_HASHED",
    "REFERENCES",
    "Reference",
    "ReportKeys",
    "ReportSettings",
    "ReportedView",
    "Status",
    "Thumbnails",
    "contact_sheet",
    "file_hash",
    "references_used",
    "render_cohort",
    "render_report",
    "run_hash",
    "run_record",
]
