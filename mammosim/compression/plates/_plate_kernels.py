"""A plate as a solid: how deep a place lies in it, and which way is out.

A plate is a NamedTuple of numbers in lattice units, of one class for each shape. Each shape has a
`_..._kernels.py` of its own with its class and its formula, and a line in the table `SHAPES`.
"""

from mammosim._jit import chosen_by_type


@chosen_by_type
def depth_in_plate(plate, x, y, z):
    """Depth of a place in a plate and the plate's outward unit normal there.

    Parameters
    ----------
    plate : NamedTuple
    x, y, z : float
        Place, lattice units.

    Returns
    -------
    depth : float
        Length of the shortest way out, negative outside: less the signed distance.
    nx, ny, nz : float
        Outward normal, along which the plate pushes.
    """
    raise NotImplementedError
