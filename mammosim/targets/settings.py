"""Settings of the targets."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mammosim.config import MAX_FORCE_N, MAX_LENGTH_MM, Settings


class BiopsySettings(Settings):
    """How the breast is held while a needle is guided to the target of a mammogram."""

    view: Literal["same", "CC", "MLO", "ML", "none"] = "none"
    """Compression during biopsy: `same`, that of each mammogram with another thickness or force;
    one of the views; or `none`, the breast as in the phantom."""

    thickness_mm: float | None = Field(default=None, ge=1, le=MAX_LENGTH_MM)
    """Gap between the plates during biopsy, mm; default: as in the mammogram of that view."""

    force_n: float | None = Field(default=None, ge=0.1, le=MAX_FORCE_N)
    """Force on the paddle during biopsy, N, instead of a thickness."""

    posture: Literal["standing", "prone", "supine"] | None = None
    """Posture during biopsy or surgery, without plates; experimental. Default: the breast as in the
    phantom."""

    needle: Literal["vertical", "lateral"] = "vertical"
    """Direction of the needle: `vertical` along the compression axis (without plates, that of the
    mammogram), from the paddle's side; `lateral` across it, parallel to the chest wall."""

    @model_validator(mode="after")
    def _a_compression_of_its_own(self) -> Self:
        ways = [key for key in ("thickness_mm", "force_n") if getattr(self, key) is not None]
        if self.view == "none" and ways:
            raise ValueError(f"view: none has no plates, so {' and '.join(ways)} must not be given")
        if self.view != "none" and self.posture is not None:
            raise ValueError(
                f"posture: {self.posture} needs view: none, since plates hold the breast"
            )
        if self.view == "same" and not ways:
            raise ValueError(
                "view: same needs thickness_mm or force_n, otherwise nothing would differ"
            )
        if len(ways) > 1:
            raise ValueError("give one of thickness_mm and force_n")
        return self


class UncertaintySettings(Settings):
    """What is varied to estimate the uncertainty of a shift, and how far."""

    samples: int = Field(default=50, ge=10, le=10_000)
    """Number of compressions drawn for each view; 50 give the ellipsoid's axes to about 10 %."""

    # Relative standard deviations between samples of one tissue: fat 28 %, gland 19 % (Samani,
    # Zubovits & Plewes 2007, Phys Med Biol 52:1565), fat 39 %, gland 50 % (Krouskop et al. 1998,
    # Ultrason Imaging 20:260).
    stiffness_spread: float = Field(default=0.35, ge=0, le=1)
    """Standard deviation of the logarithm of each tissue's modulus, drawn independently."""

    # Readouts were off by up to 14 % with rigid paddles, 7 mm of 50 (Hauge et al. 2012, Med Phys
    # 39:263).
    thickness_mm: float = Field(default=5.0, ge=0, le=30)
    """Largest deviation of the compressed thickness in either direction, mm, uniform."""

    plate_height_mm: float = Field(default=5.0, ge=0, le=30)
    """Largest deviation of the height of both plates along their normal in either direction, mm,
    uniform (assumed)."""

    # Positioning is accepted where the nipple lines of CC and MLO agree to 10 mm.
    plate_edge_mm: float = Field(default=5.0, ge=0, le=30)
    """Largest deviation, in either direction, of how far the breast is drawn between the plates,
    mm, uniform."""

    # Nobody measured it in women. Simulations came nearest to compressed breasts with tissue that
    # is stiffer from front to back (Tanner et al. 2011, Med Phys 38:682).
    fibre_ratio: float = Field(default=3.0, ge=1, le=20)
    """Largest ratio of the stiffness along fibres to that across them (model `hyperelastic`), drawn
    uniformly between 1 and this value, or between 1 and twice `compression.fibres.ratio` minus 1 if
    that is larger (assumed); 1: as in the compression."""

    lattice: bool = True
    """Also shift the lattice by up to half its spacing, to include the effect of its stepped
    surface."""


class TargetsSettings(Settings):
    """What is computed for lesions and landmarks in addition to the table."""

    biopsy: BiopsySettings | None = None
    """How the breast is held at biopsy; default: no biopsy is simulated."""

    uncertainty: UncertaintySettings | None = None
    """Variation of what is not known exactly; default: none. Every view, and the biopsy if it has
    plates, must be compressed (not model `none`)."""
