"""The hyperelastic body: elements, contact, Newton's method, and the way there from rest."""

from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic.stages import Stages
from mammosim.compression.hyperelastic.surface import SurfacePoints
from mammosim.compression.hyperelastic.trust_region import minimise

__all__ = ["Body", "Contact", "Stages", "State", "SurfacePoints", "minimise"]
