"""What a run says about itself: the record in run.json and the HTML page."""

from mammosim.report.cohort_page import render_cohort
from mammosim.report.contact_sheet import Thumbnails, contact_sheet
from mammosim.report.hanging import Picture, targets_of
from mammosim.report.keys import ReportKeys
from mammosim.report.notebook import breast_html, compressed_html, mammogram_html, study_html
from mammosim.report.page import ReportedView, render_report
from mammosim.report.plots import plot_breast, plot_compressed, plot_mammogram, plot_study
from mammosim.report.quantities import key_in_words, number, quantity
from mammosim.report.record import NOT_HASHED, Status, file_hash, run_hash, run_record
from mammosim.report.references import REFERENCES, Reference, references_used
from mammosim.report.saved import (
    SavedImage,
    hang_saved,
    marks_svg,
    number_table_html,
    pictures_css,
    planes_page,
    text_table_html,
)
from mammosim.report.settings import ReportSettings

__all__ = [
    "NOT_HASHED",
    "REFERENCES",
    "Picture",
    "Reference",
    "ReportKeys",
    "ReportSettings",
    "ReportedView",
    "SavedImage",
    "Status",
    "Thumbnails",
    "breast_html",
    "compressed_html",
    "contact_sheet",
    "file_hash",
    "hang_saved",
    "key_in_words",
    "mammogram_html",
    "marks_svg",
    "number",
    "number_table_html",
    "pictures_css",
    "planes_page",
    "plot_breast",
    "plot_compressed",
    "plot_mammogram",
    "plot_study",
    "quantity",
    "references_used",
    "render_cohort",
    "render_report",
    "run_hash",
    "run_record",
    "study_html",
    "targets_of",
    "text_table_html",
]
