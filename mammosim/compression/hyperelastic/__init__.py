"""The hyperelastic body: elements, contact, Newton's method, and the way there from rest."""

from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.hyperelastic.contact import Contact, SurfacePoints
from mammosim.compression.hyperelastic.newton import State, minimise
from mammosim.compression.hyperelastic.stages import Stages

__all__ = ["Body", "Contact", "Stages", "State", "SurfacePoints", "minimise"]
