"""The files of a run: DICOM objects, TIFF and PNG pictures, volumes and tables."""

from mammosim.export.atomic import PART_PREFIX, whole_file, write_json, write_text
from mammosim.export.convert import Conversion, convert_volume
from mammosim.export.dicom import write_dicom
from mammosim.export.gantry_file import read_geometry, write_geometry
from mammosim.export.identity import StudyIdentity
from mammosim.export.keys import ExportKeys, PatientKeys
from mammosim.export.learning import write_learning_pair
from mammosim.export.lesion_masks import LesionMask, label_image, lesion_masks
from mammosim.export.matlab import write_matlab
from mammosim.export.measurements import write_measurements
from mammosim.export.path_lengths import load_path_lengths, write_path_lengths
from mammosim.export.patient_settings import PatientSettings, age_problems
from mammosim.export.phantom_files import write_phantom
from mammosim.export.pictures import (
    write_density_tiff,
    write_full_picture,
    write_glandular_tiff,
    write_lesion_lengths_tiff,
    write_lesion_tiff,
    write_mammogram_tiff,
    write_preview,
    write_stack_tiff,
)
from mammosim.export.segmentation import write_segmentation
from mammosim.export.series import (
    reconstruction_geometry,
    series_geometry,
    write_reconstruction,
    write_series,
)
from mammosim.export.settings import ExportSettings
from mammosim.export.slice_masks import SliceMask, slice_masks
from mammosim.export.tables import (
    compression_summary,
    csv_text,
    read_lesions,
    text_of_csv,
    write_compression,
    write_convergence,
    write_lesions,
    write_table,
)
from mammosim.export.victre import write_victre
from mammosim.export.view import save_mammogram, write_compressed, write_draw, write_images
from mammosim.export.viewer_files import MARKUPS_FILE, write_markups
from mammosim.export.volumes import (
    read_compressed_labels,
    read_displacement,
    write_displacement,
    write_labels,
    write_lattice,
)
from mammosim.export.voxel_files import WRITERS

__all__ = [
    "MARKUPS_FILE",
    "PART_PREFIX",
    "WRITERS",
    "Conversion",
    "ExportKeys",
    "ExportSettings",
    "LesionMask",
    "PatientKeys",
    "PatientSettings",
    "SliceMask",
    "StudyIdentity",
    "age_problems",
    "compression_summary",
    "convert_volume",
    "csv_text",
    "label_image",
    "lesion_masks",
    "load_path_lengths",
    "read_compressed_labels",
    "read_displacement",
    "read_geometry",
    "read_lesions",
    "reconstruction_geometry",
    "save_mammogram",
    "series_geometry",
    "slice_masks",
    "text_of_csv",
    "whole_file",
    "write_compressed",
    "write_compression",
    "write_convergence",
    "write_density_tiff",
    "write_dicom",
    "write_displacement",
    "write_draw",
    "write_full_picture",
    "write_geometry",
    "write_glandular_tiff",
    "write_images",
    "write_json",
    "write_labels",
    "write_lattice",
    "write_learning_pair",
    "write_lesion_lengths_tiff",
    "write_lesion_tiff",
    "write_lesions",
    "write_mammogram_tiff",
    "write_markups",
    "write_matlab",
    "write_measurements",
    "write_path_lengths",
    "write_phantom",
    "write_preview",
    "write_reconstruction",
    "write_segmentation",
    "write_series",
    "write_stack_tiff",
    "write_table",
    "write_text",
    "write_victre",
]
